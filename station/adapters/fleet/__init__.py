"""Engines that compute portions of a fleet, and the tables in which their results are kept."""
