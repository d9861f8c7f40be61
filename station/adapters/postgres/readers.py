"""People who ask the plant by database roles of their own, and what each may see."""

from collections.abc import Sequence

from psycopg import sql

from station.adapters.postgres.connections import Connections

#: What a reader's role may select; row-level security says which rows.
_READABLE = (
    *("document", "attempt", "event", "visit", "write", "result", "finish", "archive", "log", "batch", "counter"),
    *("setting", "schema_version", "my_grants", "repeat", "day_yield"),
)
_GROUP = "plant_reader"


def grant(connections: Connections, name: str, stations: Sequence[str], products: Sequence[str]) -> None:
    """The role, made where there is none, sees what is named and nothing else; no station or product named: all.

    Errors: StoreFault.
    """
    rows = [(name, station, product) for station in stations or [""] for product in products or [""]]
    with connections.one() as connection, connection.transaction():
        for role, login in ((_GROUP, False), (name, True)):
            known = connection.execute("SELECT 1 FROM pg_roles WHERE rolname = %s", [role]).fetchone()
            if known is None:
                word = sql.SQL("LOGIN" if login else "NOLOGIN")
                connection.execute(sql.SQL("CREATE ROLE {} {}").format(sql.Identifier(role), word))
        readable = sql.SQL(", ").join(map(sql.Identifier, _READABLE))
        connection.execute(sql.SQL("GRANT SELECT ON {} TO {}").format(readable, sql.Identifier(_GROUP)))
        connection.execute(sql.SQL("GRANT {} TO {}").format(sql.Identifier(_GROUP), sql.Identifier(name)))
        connection.execute("DELETE FROM grants WHERE name = %s", [name])
        with connection.cursor() as cursor:
            cursor.executemany("INSERT INTO grants VALUES (%s, %s, %s)", rows)
