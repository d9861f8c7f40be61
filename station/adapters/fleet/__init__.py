"""Engines that compute portions of a fleet, and the tables in which their results are kept."""

from station.optional_imports import load_arrow

load_arrow()
