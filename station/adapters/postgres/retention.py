"""Raw frames go after their time; the records that hold their hashes stay, and so does every chain."""

from station.adapters.postgres.connections import Connections
from station.ports.objects import ObjectStore

_DAY_NS = 86_400 * 10**9

#: ObjectStore that no attempt needs any more: of every attempt that has them, the time is over.
_DUE = """SELECT o.sha256, o.bytes FROM object o WHERE o.retired_ns IS NULL
    AND EXISTS (SELECT 1 FROM archive r WHERE r.data = o.sha256)
    AND NOT EXISTS (SELECT 1 FROM archive r JOIN finish f ON f.attempt = r.attempt WHERE r.data = o.sha256
        AND f.ended_ns >= CASE WHEN f.outcome = 'PASS' THEN %(passed)s::bigint ELSE %(other)s::bigint END)"""


def retire(
    connections: Connections, objects: ObjectStore, days: tuple[float | None, float | None], now_ns: int
) -> tuple[int, int]:
    """days: for how long frames of attempts that passed, and of all others, are kept; None: for ever. How many objects
    went, and how many bytes. What is noted first is removed by the next call, if this one ends between. Errors:
    StoreFault."""
    before = [0 if d is None else now_ns - int(d * _DAY_NS) for d in days]
    with connections.one() as connection:
        due = connection.execute(_DUE, {"passed": before[0], "other": before[1]}).fetchall()
        for sha256, _ in due:
            objects.remove(bytes(sha256))
            connection.execute("UPDATE object SET retired_ns = %s WHERE sha256 = %s", [now_ns, sha256])
    return len(due), sum(int(size) for _, size in due)
