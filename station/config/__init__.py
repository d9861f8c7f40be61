"""Text files into frozen settings, recipes and products; every mistake with file, line and key."""
