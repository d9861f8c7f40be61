"""Protocols of the outside world: bus, device, positioner, store, clock. Nothing here does anything."""
