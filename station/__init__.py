"""End-of-line calibration station for CAN devices."""

__version__ = "0.2.0"
