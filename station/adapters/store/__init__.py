"""The log in SQLite. sqlite-utils would load pandas to store its time stamps, which no table here holds."""

from station.lean import without

with without("pandas"):
    import sqlite_utils as sqlite_utils
