"""The log in SQLite. sqlite-utils would load pandas to store its time stamps, which no table here holds."""

from station.optional_imports import hide_packages

with hide_packages("pandas"):
    import sqlite_utils as sqlite_utils
