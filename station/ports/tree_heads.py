"""Where a witness keeps the tree heads that it has seen: append-only."""

from collections.abc import Sequence
from typing import Protocol

from station.domain.records.tree_head import TreeHead


class TreeHeads(Protocol):
    """The newest head of each log. Errors: StoreFault."""

    def of_station(self, station: str) -> Sequence[TreeHead]:
        """The newest head of each log of a station, in the order in which the logs were first seen."""

    def append(self, head: TreeHead, at_ns: int, replaces: str) -> None:
        """Keeps a head, and what it replaces; when this returns, it is on the disk."""
