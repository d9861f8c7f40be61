"""The station's side of drives with the profile CiA 402."""
