"""Causes shared by units of a fleet, in memory that does not grow with the number of units."""
