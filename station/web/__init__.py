"""The operator's page, the auditor's answers and the engineer's charts; a process of its own that reads the log."""
