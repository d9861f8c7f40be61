"""What the files of a new product suggest: roles of signals, a device map, a recipe; each to be checked."""
