"""The log as it is shipped: its records by their numbers with the bytes that were sealed. Implements RecordSource."""

from pathlib import Path

from station.adapters.store import file, verify
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite_errors import translate_errors
from station.domain.records.chain import canonical
from station.domain.records.wire import WireRecord
from station.errors import LogError
from station.ports.plant import Claim

#: Records that are read at a time.
_PORTION_RECORDS = 1000

_SELECT = {
    table: f'SELECT seq, hash, signature, {", ".join(columns)} FROM "{table}" WHERE seq > ? AND seq <= ?'
    for table, columns in COLUMNS.items()
}


class LogOutbox:
    """`open` at the making; `close` at the end. Each read is one short transaction, so that the log's own upkeep waits
    for nobody."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._db = file.open_for_reading(path)
        self._db.conn.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
        with translate_errors(LogError, path, "read"):
            self._log_id = verify.log_id(self._db)

    def close(self) -> None:
        """Closes the log; twice is harmless."""
        self._db.close()

    @property
    def log_id(self) -> str:
        """What sets the log apart."""
        return self._log_id

    def newest(self) -> Claim:
        """Number and seal of the newest record."""
        with translate_errors(LogError, self._path, "read"):
            number, seal = file.newest(self._db.conn, self._log_id)
        return Claim(number, seal.hex())

    def seals(self, first: int, last: int) -> list[bytes]:
        """Seals of records first … last."""
        with translate_errors(LogError, self._path, "read"):
            return file.seals(self._db.conn, first - 1, last - first + 1)

    def read(self, after: int, most_bytes: int) -> list[WireRecord]:
        """The records after a number, in order, without a gap, of about so many bytes."""
        found = list[WireRecord]()
        with translate_errors(LogError, self._path, "read"):
            for table, query in _SELECT.items():
                for seq, seal, signature, *values in self._db.conn.execute(query, (after, after + _PORTION_RECORDS)):
                    body = canonical(table, COLUMNS[table], values)
                    found.append(WireRecord(seq, bytes(seal), bytes(signature or b""), body))
        found.sort(key=lambda record: record.number)
        size = 0
        for count, record in enumerate(found):
            size += record.size
            if size > most_bytes and count:
                return found[:count]
        return found
