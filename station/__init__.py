"""End-of-line calibration station for CAN devices."""

__version__ = "0.1.0"
