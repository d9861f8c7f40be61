"""What certificates were issued goes into the log, so that `certificate --check` knows their files again."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from station.config.settings import Settings
from station.domain.records.issued_certificate import IssuedFile
from station.errors import StationError
from station.messages import Message
from station.service.certificates import seal_issued_files
from station.wiring.logs import plant_address
from station.wiring.sealing import seal_now


def seal_issued(location: str, settings: Settings, attempt: str, files: Sequence[IssuedFile]) -> Message | None:
    """Seals the files under their attempt; a run that holds the log does it. None, or why the log does not hold them:
    a copy, a log of a plant or of another station's key is read all the same."""
    if plant_address(location):
        return Message("certificate-not-sealed-plant")
    documents = [file.document() for file in files]
    write = partial(seal_issued_files, attempt=attempt, files=documents)
    try:
        seal_now(Path(location), settings, write, "certificate", {"attempt": attempt, "files": documents})
    except StationError as error:
        return Message("certificate-not-sealed", why=error.sentence)
    return None
