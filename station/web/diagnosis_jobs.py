"""Diagnoses that the page began: a folder each beside the log, with the question, and `station diagnose` as a child."""

import json
import secrets
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from station.errors import LogError, UsageError
from station.files.json_text import read_json
from station.files.replace import replace_text
from station.panel_protocol.companion import Companion, companion_file
from station.ports.log_reader import Attempt, LogReader, Query
from station.service import stored_attempts
from station.web.panel import Panel
from station.wiring.sample_files import join, write_samples

#: So many units at most in one diagnosis; so many diagnoses on the page's list.
MOST_UNITS, MOST_LISTED = 200, 50
#: So many diagnoses at a time: each keeps a core busy, and the station works beside it.
MOST_PARALLEL = 1
#: Until the first has shown how long it takes here: to start, and for each sample, s.
#: No diagnosis of so many units as the page takes is longer.
_MOST_BYTES = 64_000_000
_START_S, _SAMPLE_S = 3.0, 1e-4


@dataclass(frozen=True, slots=True)
class DiagnosisJob:
    """What was asked. question: fields of the form that were filled; samples: how many; begun_ns: since 1970."""

    name: str
    person: str
    begun_ns: int
    question: Mapping[str, str]
    units: int
    recipe: str
    samples: int


@dataclass(frozen=True, slots=True)
class DiagnosisState:
    """working: under way, for elapsed_s, expected to take expected_s; report: it is there; verdict: '' without one;
    words: what the child said at its end."""

    job: DiagnosisJob
    working: bool
    elapsed_s: float
    expected_s: float
    report: bool
    verdict: str
    words: str


def start_diagnosis(
    panel: Panel, person: str, serials: Sequence[str], question: Mapping[str, str], query: Query
) -> str:
    """Writes the samples of the attempts, starts the child; the name of the diagnosis. serials: picked ones; else the
    newest attempts that the query names. Errors: UsageError, LogError."""
    if sum(child.poll() is None for child in panel.children.values()) >= MOST_PARALLEL:
        raise UsageError("diagnosis-under-way")
    with panel.log() as log:
        attempts = _of_one_recipe(_attempts(log, serials, query))
        tables = list(stored_attempts.samples(log, attempts))
        recipe_json = log.recipe_and_product(attempts[-1])[0] if attempts else ""
    if not tables:
        raise LogError("diagnosis-no-visits")
    name, table = secrets.token_hex(8), join(tables)
    folder = companion_file(panel.order.database, Companion.DIAGNOSES) / name
    folder.mkdir(parents=True)
    (folder / "recipe.yaml").write_text(recipe_json, encoding="utf-8")  # JSON is YAML
    write_samples(table, folder / "samples.parquet")
    units = len({a.serial for a in attempts})
    job = DiagnosisJob(name, person, time.time_ns(), dict(question), units, attempts[-1].recipe_name, len(table.time_s))
    replace_text(folder / "job.json", json.dumps(asdict(job)))
    words = ["diagnose", "--samples", "samples.parquet", "--recipe", "./recipe.yaml", "--report", "report.html"]
    with (folder / "said.txt").open("wb") as output:
        panel.children[name] = subprocess.Popen(
            [sys.executable, "-P", "-m", "station", *words, "--json", "diagnosis.json"],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
        )  # fmt: skip
    return name


def diagnosis_state(panel: Panel, name: str) -> DiagnosisState:
    """How far one is. Errors: UsageError where there is none of that name."""
    folder = diagnosis_folder(panel, name)
    return _state(panel, folder, _job(folder))


def earlier_diagnoses(panel: Panel) -> list[DiagnosisState]:
    """All that are there, newest first."""
    place = companion_file(panel.order.database, Companion.DIAGNOSES)
    jobs = [(folder, _job(folder)) for folder in place.glob("*") if (folder / "job.json").exists()]
    jobs.sort(key=lambda pair: -pair[1].begun_ns)
    return [_state(panel, folder, job) for folder, job in jobs[:MOST_LISTED]]


def diagnosis_folder(panel: Panel, name: str) -> Path:
    """Where one stands. Errors: UsageError."""
    folder = companion_file(panel.order.database, Companion.DIAGNOSES) / name
    if len(name) != 16 or set(name) - set("0123456789abcdef") or not folder.is_dir():
        raise UsageError("diagnosis-unknown")
    return folder


def _attempts(log: LogReader, serials: Sequence[str], query: Query) -> list[Attempt]:
    if serials:
        return [a for serial in serials for a in log.attempts(Query(serial=serial))]
    found = log.attempts(query, 4 * MOST_UNITS)
    units = list(dict.fromkeys(a.serial for a in found))[:MOST_UNITS]
    return [a for a in found if a.serial in units]


def _of_one_recipe(found: list[Attempt]) -> list[Attempt]:
    """The attempts with the newest one's recipe, oldest first: a diagnosis is of one recipe."""
    in_order = sorted(found, key=lambda a: a.started_ns)
    return [a for a in in_order if a.recipe_hash == in_order[-1].recipe_hash]


def _job(folder: Path) -> DiagnosisJob:
    """An older folder has none: it is shown by its name alone."""
    document = _read(folder / "job.json")
    return DiagnosisJob(**document) if document else DiagnosisJob(folder.name, "", 0, {}, 0, "", 0)


def _state(panel: Panel, folder: Path, job: DiagnosisJob) -> DiagnosisState:
    child = panel.children.get(job.name)
    working, report = child is not None and child.poll() is None, folder / "report.html"
    last_words = "" if working else _text(folder / "said.txt")[-500:]
    verdict = str(_read(folder / "diagnosis.json").get("verdict", ""))
    elapsed_s = max(0.0, (time.time_ns() - job.begun_ns) / 1e9)
    return DiagnosisState(job, working, elapsed_s, _expected_s(folder, job), report.exists(), verdict, last_words)


def _expected_s(folder: Path, job: DiagnosisJob) -> float:
    """By how long those before took for each sample."""
    rates = []
    for other in folder.parent.glob("*/report.html"):
        before = _job(other.parent)
        if before.samples:
            rates.append((other.stat().st_mtime - before.begun_ns / 1e9 - _START_S) / before.samples)
    return _START_S + job.samples * max(median(rates) if rates else _SAMPLE_S, 1e-6)


def _read(path: Path) -> dict[str, Any]:
    try:
        document = read_json(path, _MOST_BYTES)
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
