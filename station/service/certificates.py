"""A unit's certificate out of the log, and what was issued into it."""

from collections.abc import Mapping, Sequence
from typing import Any

from station.domain.records.issued_certificate import ISSUED, IssuedFile
from station.ports.log_reader import Attempt, LogReader
from station.ports.store import Store
from station.reporting.certificate.document import Certificate, build
from station.reporting.words import Words
from station.service.recompute import parse_recipe_and_product
from station.service.witnessed import newest_receipt


def certificate_of(log: LogReader, attempt: Attempt, words: Words) -> Certificate:
    """The certificate of one ended attempt. Errors: LogError where it came to no calibration."""
    recipe, product, _ = parse_recipe_and_product(*log.recipe_and_product(attempt))
    receipt = newest_receipt(log)
    return build(log.attempt(attempt), recipe, log.head(), words, receipt=receipt, device_map=product.map)


def seal_issued_files(store: Store, attempt: str, files: Sequence[Mapping[str, Any]]) -> None:
    """Seals what was issued under an attempt. Errors: StoreFault; KeyError, TypeError, ValueError where it is none."""
    for file in [IssuedFile.of(document) for document in files]:
        store.event(attempt, ISSUED, file.document())
