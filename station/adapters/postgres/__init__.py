"""The plant's records in PostgreSQL: what arrives is kept as it was sealed, and read through the log-reader port."""
