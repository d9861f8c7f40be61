"""A fixture that drives turn: their profile, the map of a rig, its kinematics, safe ways, and what is wrong with it."""
