"""What prints labels of units: one file a kind."""
