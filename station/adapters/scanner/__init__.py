"""What reads the labels of units: one file a kind."""
