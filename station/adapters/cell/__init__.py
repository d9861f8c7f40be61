"""What brings loads to the station and takes them back: one file a kind."""
