"""Where alerts of the watch go beside the log and the page."""

from collections.abc import Mapping
from typing import Any, Protocol


class AlertChannel(Protocol):
    """One receiver of alerts."""

    @property
    def name(self) -> str:
        """What tells it from the others, without a password."""

    def send(self, document: Mapping[str, Any]) -> None:
        """One station.alert/1; returns when the receiver has it. Errors: OSError."""
