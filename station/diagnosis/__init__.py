"""What the simulation gets wrong: floor, candidates, search, sizes, gains, next run."""
