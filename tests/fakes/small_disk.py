"""`python -m tests.fakes.small_disk FOLDER KIB…`: a simulated run with its log on a file system of so many KiB, each.

Wants a mount namespace of its own (`unshare -m`, or `unshare -Urm` as a plain user). Prints what each run showed and
what its log held when there was space again, as JSON.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import StationError
from station.ports.log_reader import Query, Trust
from tests.fakes import fixture_run

SERIAL = "SN0001"


def one_run(folder: Path, kib: int) -> dict[str, Any]:
    """The run, and then the log."""
    disk, devices = folder / f"disk{kib}", folder / f"devices{kib}"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", str(disk)], check=True)
    log = disk / "station.db"
    shown: dict[str, Any] = {"kib": kib, "shown": None, "sentences": []}
    try:
        ran = fixture_run.run(folder, database=log, device_state=devices)
    except StationError as refused:
        shown["sentences"] = [refused.sentence]
    else:
        result = ran.results.get(SERIAL)
        shown["shown"] = None if result is None else str(result.outcome)
        reasons = [] if result is None else [r.sentence for r in result.reasons]
        shown["sentences"] = [*reasons, *([ran.fault.sentence] if ran.fault else [])]
    subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
    shown["saved"] = (devices / f"{SERIAL}.json").exists()
    return {**shown, **_log(log), "goes_on": _next(folder, log, devices)}


def _log(path: Path) -> dict[str, Any]:
    if not path.exists() or not path.stat().st_size:
        return {"findings": [], "outcome": None, "writes": 0}
    SqliteStore(path).close()
    with SqliteLogReader(path) as log:
        found = [f.what for f in log.findings(Trust())]
        lives = log.life(Query(serial=SERIAL))
    last = lives[-1] if lives else {"outcome": None, "writes": []}
    return {"findings": found, "outcome": last["outcome"], "writes": len(last["writes"])}


def _next(folder: Path, log: Path, devices: Path) -> str:
    """How the same unit fares on the same log once there is space."""
    return str(fixture_run.run(folder, database=log, device_state=devices, seed=2).results[SERIAL].outcome)


if __name__ == "__main__":
    json.dump([one_run(Path(sys.argv[1]), int(kib)) for kib in sys.argv[2:]], sys.stdout)
