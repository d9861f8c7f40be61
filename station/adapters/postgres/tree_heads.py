"""Tree heads that a plant keeps as a witness; implements `ports.tree_heads.TreeHeads`."""

import json
from collections.abc import Sequence

from station.adapters.postgres.connections import Connections
from station.domain.records.tree_head import TreeHead

_NEWEST = """SELECT head FROM (SELECT DISTINCT ON (log_id) id, head FROM tree_head WHERE station = %s
    ORDER BY log_id, id DESC) t ORDER BY id"""


class PostgresTreeHeads:
    """Append-only. Errors: StoreFault."""

    def __init__(self, connections: Connections) -> None:
        self._connections = connections

    def of_station(self, station: str) -> Sequence[TreeHead]:
        """The newest head of each log of a station; the one that was kept last comes last."""
        with self._connections.one() as connection:
            return [TreeHead.of(json.loads(text)) for (text,) in connection.execute(_NEWEST, [station])]

    def append(self, head: TreeHead, at_ns: int, replaces: str) -> None:
        """Keeps a head, and what it replaces; when this returns, it is on the disk."""
        values = [head.station, head.log_id, at_ns, replaces, json.dumps(head.document())]
        with self._connections.one() as connection:
            connection.execute(
                "INSERT INTO tree_head (station, log_id, at_ns, replaces, head) VALUES (%s, %s, %s, %s, %s)", values
            )
