"""Whether a witness really countersigned the log as it is: its signature, over the tree of the log's own seals."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from station.adapters.store import file, keys, verify
from station.config.settings import WitnessSettings
from station.domain.records.merkle import Tree
from station.domain.records.tree_head import TreeHead, receipt_statement


def is_countersigned(path: Path, station: str, witness: WitnessSettings, receipt: Mapping[str, Any]) -> bool:
    """station: as the log's heads call it. Errors: LogError, UsageError for a key that cannot be read."""
    key, size = keys.load_public_key(Path(witness.public_key)), int(receipt["size"])
    db = file.open_for_reading(path)
    try:
        log_id, seal = verify.log_id(db), file.seal_of(db.conn, size)
        own = keys.schedule(db.conn, log_id).key_at(size)
        if seal is None or own is None:
            return False
        root = Tree(partial(file.seals, db.conn)).root(size).hex()
        signature = file.signature_of(db.conn, size).hex()
    finally:
        db.close()
    head = TreeHead(log_id, station, size, root, seal.hex(), signature, own.hex())
    return keys.verify(key, bytes.fromhex(receipt["signature"]), receipt_statement(head, int(receipt["at_ns"])))
