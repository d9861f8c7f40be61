"""The plant's tables: numbered SQL files, each run once, in one transaction, by one process at a time."""

import re
from importlib.resources import files

import psycopg

from station.adapters.postgres.connections import Connections
from station.errors import StoreFault
from station.messages import Message

#: The advisory lock of all who migrate: "plant" in hexadecimal of its letters.
_LOCK = 0x706C616E74


def migrations() -> list[tuple[int, str]]:
    """Numbers and texts of the steps, in their order."""
    folder = files(__package__).joinpath("migrations")
    return sorted(
        (int(match[1]), file.read_text(encoding="utf-8"))
        for file in folder.iterdir()
        if (match := re.fullmatch(r"(\d{4})_\w+\.sql", file.name))
    )


def migrate(connections: Connections) -> int:
    """Brings the database to this version's schema; its number. Errors: StoreFault."""
    with connections.one() as connection, connection.transaction():
        connection.execute("SELECT pg_advisory_xact_lock(%s)", [_LOCK])
        connection.execute(
            "CREATE TABLE IF NOT EXISTS schema_version (number integer PRIMARY KEY, at timestamptz DEFAULT now())"
        )
        done = _version(connection)
        steps = migrations()
        if done > steps[-1][0]:
            raise StoreFault(Message("plant-schema-newer", location=connections.location, number=done))
        for number, text in steps:
            if number > done:
                connection.execute(text.encode())
                connection.execute("INSERT INTO schema_version (number) VALUES (%s)", [number])
    return steps[-1][0]


def note_objects(connections: Connections, address: str) -> None:
    """Tells readers where the objects of raw frames are."""
    with connections.one() as connection:
        connection.execute(
            "INSERT INTO setting VALUES ('objects', %s) ON CONFLICT (name) DO UPDATE SET value = excluded.value",
            [address],
        )


def _version(connection: psycopg.Connection) -> int:
    row = connection.execute("SELECT coalesce(max(number), 0) FROM schema_version").fetchone()
    assert row
    return int(row[0])
