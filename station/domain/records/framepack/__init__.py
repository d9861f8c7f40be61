"""Frames at rest: lossless and small. `codec` is the door; each other file is one step."""
