"""The OPC UA package's own types."""

from typing import Any


def opc_ua() -> Any:
    """They are loaded late: that takes a second."""
    from asyncua import ua

    return ua
