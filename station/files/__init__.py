"""Files as this station changes them: replaced whole or not at all, and owned by one process at a time."""
