"""Connections to PostgreSQL: made when first needed, kept while they are well, and its complaints as sentences."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

from station.errors import StationError, StoreFault
from station.messages import Message

try:
    import psycopg
except ImportError as missing:
    raise StoreFault("plant-not-installed") from missing

#: The unit of `connect_timeout` is a second.
_CONNECT_TIMEOUT_S = 5
#: Whoever holds a row, a table or the migration's lock for longer gets the next one refused, and it comes again.
_LOCK_TIMEOUT_S = 10.0
#: Why the client library did not get in, by its words: it gives these refusals no code.
_NOT_CONNECTED = (
    (r"password|authentication|pg_hba", "plant-no-entry"),
    (r"role .* does not exist", "plant-no-entry"),
    (r"database .* does not exist", "plant-no-database"),
    (r"translate host name|resolve host", "system-no-such-host"),
    (r"timeout|timed out", "system-timed-out"),
    (r"SSL|certificate", "plant-tls-refused"),
)


@contextmanager
def translate_errors(kind: type[StationError], location: str, id_: str = "plant-database") -> Iterator[None]:
    """Turns what PostgreSQL reports into `kind`."""
    try:
        yield
    except psycopg.Error as error:
        raise kind(Message(id_, location=location, why=_reason(error))) from error


def _reason(error: psycopg.Error) -> Message:
    """Why there is no connection; of a statement, what the server says."""
    if error.diag.message_primary:
        return Message.text(" ".join(error.diag.message_primary.split()))
    text = str(error)
    return next((Message(id_) for words, id_ in _NOT_CONNECTED if re.search(words, text)), Message("plant-no-server"))


def connect(address: str, *, read_only: bool = False) -> "psycopg.Connection":
    """One connection; every statement is its own transaction unless a block says otherwise."""
    options = "-c default_transaction_read_only=on" if read_only else ""
    return psycopg.connect(
        address,
        autocommit=True,
        connect_timeout=_CONNECT_TIMEOUT_S,
        application_name="station",
        options=options,
    )


class Connections:
    """Connections of one process. location: as sentences name the database, without a password."""

    def __init__(self, address: str, lock_timeout_s: float = _LOCK_TIMEOUT_S) -> None:
        self._address, self._idle = address, list[psycopg.Connection]()
        self._lock_timeout = f"{lock_timeout_s * 1e3:.0f}ms"
        self._turn = Lock()
        self.location = without_password(address)

    @contextmanager
    def one(self) -> "Iterator[psycopg.Connection]":
        """A connection for this block alone. One that broke is not used again. Errors: StoreFault."""
        with translate_errors(StoreFault, self.location):
            with self._turn:
                connection = self._idle.pop() if self._idle else None
            if connection is None or connection.closed:
                connection = connect(self._address)
                connection.execute("SELECT set_config('lock_timeout', %s, false)", [self._lock_timeout])
            try:
                yield connection
            except BaseException:
                if connection.broken:  # by the server's end, which those that idle have not heard of yet
                    self.close()
                with suppress(psycopg.Error):
                    connection.close()
                raise
            with self._turn:
                self._idle.append(connection)

    def close(self) -> None:
        """Closes what idles; twice is harmless."""
        with self._turn:
            while self._idle:
                self._idle.pop().close()


def without_password(address: str) -> str:
    """The address as it may stand in a sentence."""
    try:
        parts = psycopg.conninfo.conninfo_to_dict(address)
    except psycopg.Error:
        return "postgresql"
    where = f"{parts.get('host', 'localhost')}/{parts.get('dbname', '')}"
    return f"postgresql://{where}"
