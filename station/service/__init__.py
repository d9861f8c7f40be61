"""The run and the other use cases, on ports alone."""
