"""The forward simulation: a campaign of units, rig and bus, with one file for each cause."""
