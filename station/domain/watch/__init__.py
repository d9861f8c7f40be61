"""What begins to go wrong on the line: signals of each load, sequential tests of them, and where a change began."""
