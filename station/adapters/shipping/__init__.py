"""Records on their way to a plant, over HTTP."""
