"""Devices that keep objects and speak no CANopen: UDS, and vendors' protocols by frame templates."""
