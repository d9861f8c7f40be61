"""Causes that units of a fleet share, in memory that does not follow the number of units."""
