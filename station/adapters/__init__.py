"""The real parts behind the ports: buses, CANopen, positioners, store, files."""
