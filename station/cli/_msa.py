"""The work of `station msa`: which readings there are, which are missing, and what they come to."""

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from station.cli import _output
from station.cli._layout import TextTable
from station.cli._msa_runs import StudyCell, measure_missing
from station.cli._serials import check_given
from station.config.settings import load_settings
from station.domain.core.types import Floats
from station.domain.line_quality import accuracy, msa
from station.errors import UsageError
from station.messages import Message, system_reason
from station.ports.log_reader import Query
from station.reporting.line.statistics import VALUE_NAMES, limits_of
from station.service import golden_register
from station.service.line_statistics import attempt_values
from station.wiring.jobs import load_job
from station.wiring.logs import open_log
from station.wiring.run_order import RunOrder

SCHEMA = "station.msa/1"
#: Parts of a study on the simulated station that names none.
SIMULATED_PARTS = tuple(f"SN{i + 1:04d}" for i in range(10))


#: Of a study that somebody has typed or exported.
MOST_READINGS = 100_000


@dataclass(frozen=True, slots=True)
class MsaRequest:
    """What is asked; see the command's options. makes: missing readings are made."""

    study: str
    value: str
    serials: tuple[str, ...]
    repeats: int
    trials: int
    nests: int
    reference: float | None
    tolerance: float | None
    k_percent: float
    spread: float
    resolution: float
    samples: Path | None
    measures_missing: bool


def run_study(order: RunOrder, request: MsaRequest, *, as_json: bool) -> int:
    """Does the study, keeps it and tells it; the exit code. Errors: UsageError, LogError, those of a run."""
    if request.study not in STUDIES:
        raise UsageError("msa-unknown-study", study=request.study[:20], studies=tuple(STUDIES))
    if request.value not in VALUE_NAMES:
        raise UsageError("unknown-value", value=request.value[:40], values=VALUE_NAMES)
    readings = _readings_of_table(request) if request.samples is not None else _readings_of_log(order, request)
    figures = STUDIES[request.study](request, order, readings)
    document = {
        "schema": SCHEMA,
        "study": request.study,
        "value": request.value,
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "from": str(request.samples or _database(order)),
        "readings": readings.tolist(),
        **figures,
    }
    study_path = _store_study(document, request.samples or _database(order))
    if as_json:
        _output.print_json(document)
    else:
        _print_study(document)
        _output.print_line(f"study: {study_path}")
    return 0


def _type1(request: MsaRequest, order: RunOrder, readings: Floats) -> dict[str, Any]:
    if request.reference is None:
        raise UsageError("msa-without-reference")
    found = msa.type1(
        readings,
        request.reference,
        _tolerance(request, order),
        k_percent=request.k_percent,
        spread=request.spread,
        resolution=request.resolution,
    )
    capable = found.cg is not None and min(found.cg, found.cgk) >= 1.33
    settings = {"reference": request.reference, "tolerance": _tolerance(request, order)}
    settings |= {"k_percent": request.k_percent, "spread": request.spread}
    return {"settings": settings, "type1": asdict(found), "judgement": "capable" if capable else "not capable"}


def _grr(request: MsaRequest, order: RunOrder, readings: Floats) -> dict[str, Any]:
    tolerance = _tolerance(request, order) if request.tolerance is not None or request.samples is None else None
    found: dict[str, Any] = {"anova": asdict(a := msa.anova(readings, tolerance))}
    try:
        found["xbar_r"] = asdict(msa.xbar_r(readings, tolerance))
    except UsageError as exc:  # the book's constants end at ten; ANOVA knows no such end
        found["xbar_r"], found["note"] = None, exc.sentence
    return {"settings": {"tolerance": tolerance}, **found, "judgement": a.judgement}


def _bias(request: MsaRequest, _order: RunOrder, readings: Floats) -> dict[str, Any]:
    if request.reference is None:
        raise UsageError("msa-without-reference")
    found = accuracy.bias_study(readings, request.reference)
    return {"settings": {"reference": request.reference}, "bias": asdict(found), "judgement": found.judgement}


def _linearity(_request: MsaRequest, _order: RunOrder, readings: Floats) -> dict[str, Any]:
    found = accuracy.linearity(*readings.T)
    return {"settings": {}, "linearity": asdict(found), "judgement": found.judgement}


#: What makes the figures of a study out of its readings.
STUDIES: dict[str, Callable[[MsaRequest, RunOrder, Floats], dict[str, Any]]] = {
    "type1": _type1,
    "grr": _grr,
    "bias": _bias,
    "linearity": _linearity,
}
#: Columns of a study's table, and the studies that repeat one unit.
COLUMNS = {
    "type1": ("value",),
    "bias": ("value",),
    "linearity": ("reference", "value"),
    "grr": ("part", "appraiser", "trial", "value"),
}
OF_ONE_UNIT = ("type1", "bias")


def _tolerance(request: MsaRequest, order: RunOrder) -> float:
    """The full width T: as said, or between the recipe's limits of this value."""
    if request.tolerance is not None:
        if request.tolerance <= 0:
            raise UsageError("msa-tolerance-not-positive", given=request.tolerance)
        return request.tolerance
    job, _ = load_job(order.recipe or load_settings(order.config).recipe)
    lower, upper = limits_of(request.value, job.recipe.limits)
    if lower is None or upper is None:
        raise UsageError("msa-without-tolerance", value=request.value)
    return upper - lower


def _readings_of_table(request: MsaRequest) -> Floats:
    """Readings of a CSV: (n), (n, 2) with their references, or (parts, appraisers, trials). Errors: UsageError with
    file and line."""
    path = request.samples
    assert path is not None
    rows = list(_table_rows(path, COLUMNS[request.study]))
    values = [_finite(path, line, row["value"]) for line, row in rows]
    if request.study in OF_ONE_UNIT:
        return np.array(values)
    if request.study == "linearity":
        return np.array([[_finite(path, n, row["reference"]), v] for (n, row), v in zip(rows, values, strict=True)])
    cells: dict[StudyCell, list[float]] = {}
    for (_, row), value in zip(rows, values, strict=True):
        cells.setdefault((row["part"], row["appraiser"]), []).append(value)
    return crossed_readings(cells, min(map(len, cells.values()), default=0), str(path))


def _table_rows(path: Path, columns: Sequence[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """(line, cells) of every row. Errors: UsageError."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restval="")
            missing = tuple(c for c in columns if c not in (reader.fieldnames or ()))
            if missing:
                raise UsageError("msa-samples-columns", path=str(path), columns=",".join(columns), missing=missing)
            for number, row in enumerate(reader, 1):
                if number > MOST_READINGS:
                    raise UsageError("msa-samples-too-many", path=str(path), limit=MOST_READINGS)
                yield reader.line_num, row
    except OSError as exc:
        raise UsageError("option-not-read", option="--samples", path=str(path), why=system_reason(exc)) from exc
    except UnicodeDecodeError as exc:
        raise UsageError("file-not-utf8", file=str(path), byte=exc.start) from exc
    except csv.Error as exc:
        raise UsageError("samples-line-not-csv", file=str(path), line=reader.line_num + 1) from exc


def _finite(path: Path, line: int, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise UsageError("msa-samples-value", path=str(path), line=line, value=text[:40])
    return value


def _readings_of_log(order: RunOrder, request: MsaRequest) -> Floats:
    """Readings of the log, the missing ones made first where that is asked for."""
    serials = request.serials or (
        (SIMULATED_PARTS[:1] if request.study in OF_ONE_UNIT else SIMULATED_PARTS) if order.simulate else ()
    )
    if not serials:
        raise UsageError("msa-without-serials")
    nests = [n.name for n in load_settings(order.config).nests]
    if request.study == "linearity":
        return _certified_readings(order, request, serials)
    if request.study in OF_ONE_UNIT:
        if len(serials) != 1:
            raise UsageError("msa-type1-serials", count=len(serials))
        wanted = {(serials[0], nests[0]): request.repeats}
    else:
        if request.nests > len(nests) or request.nests > len(serials):
            raise UsageError("msa-too-few-parts", nests=request.nests)
        wanted = {(s, n): request.trials for s in serials for n in nests[: request.nests]}
    if request.measures_missing:
        check_given(order, serials)
        measure_missing(order, wanted, _reading_counts(order, request, serials))
    return _complete_readings(order, request, wanted)


def _certified_readings(order: RunOrder, request: MsaRequest, serials: Sequence[str]) -> Floats:
    """Readings (n, 2) of golden units with their certified values: what linearity takes from the log."""
    settings = load_settings(order.config)
    register = {} if settings.golden is None else golden_register.load(Path(settings.golden.file))
    missing = [s for s in serials if s not in register or request.value not in register[s].values]
    if missing:
        raise UsageError("msa-not-certified", value=request.value, serials=missing)
    cells = _readings_by_cell(order, request, serials)
    rows = [(register[serial].values[request.value][0], v) for (serial, _), values in cells.items() for v in values]
    return np.array(rows, float).reshape(-1, 2)


def _complete_readings(order: RunOrder, request: MsaRequest, wanted: Mapping[StudyCell, int]) -> Floats:
    cells = _readings_by_cell(order, request, sorted({serial for serial, _ in wanted}))
    for cell, count in wanted.items():
        there = len(cells.get(cell, ()))
        if there < count:
            raise UsageError("msa-too-few-readings", serial=cell[0], nest=cell[1], readings=there, count=count)
    if request.study in OF_ONE_UNIT:
        ((cell, count),) = wanted.items()
        return np.array(cells[cell][-count:])
    return crossed_readings({cell: cells[cell] for cell in wanted}, request.trials, "the log")


def _reading_counts(order: RunOrder, request: MsaRequest, serials: Sequence[str]) -> dict[StudyCell, int]:
    return {cell: len(values) for cell, values in _readings_by_cell(order, request, serials).items()}


def _readings_by_cell(order: RunOrder, request: MsaRequest, serials: Sequence[str]) -> dict[StudyCell, list[float]]:
    """(serial, nest) → readings in the log, oldest first."""
    database = _database(order)
    if not database.exists():
        return {}
    cells: dict[StudyCell, list[float]] = {}
    with open_log(database) as log:
        made = [m for serial in serials for m in attempt_values(log, Query(serial=serial), 10_000)]
    for m in made:
        if request.value in m.values and m.outcome in ("PASS", "FAIL"):
            cells.setdefault((m.serial, m.nest.partition("/")[2]), []).append(m.values[request.value])
    return cells


def crossed_readings(cells: Mapping[StudyCell, Sequence[float]], trials: int, where: str) -> Floats:
    """Readings (parts, appraisers, trials) of a crossed study. UsageError where a cell is missing."""
    parts, appraisers = (sorted({cell[i] for cell in cells}) for i in (0, 1))
    missing = [f"{p} × {a}" for p in parts for a in appraisers if len(cells.get((p, a), ())) < max(trials, 2)]
    if missing or not parts:
        raise UsageError("msa-not-crossed", log=where, missing=missing[:3])
    return np.array([[list(cells[p, a])[-trials:] for a in appraisers] for p in parts])


def _database(order: RunOrder) -> Path:
    return order.database or Path(load_settings(order.config).database)


def _store_study(document: Mapping[str, Any], source: Path) -> Path:
    """Keeps the study beside its readings; a study is never written over."""
    folder = source.with_name(f"{source.name}.studies")
    stem = f"{document['at'].replace(':', '').replace('+0000', 'Z')}-{document['study']}"
    try:
        folder.mkdir(exist_ok=True)
        for number in range(1000):
            path = folder / (f"{stem}.json" if not number else f"{stem}-{number}.json")
            if not path.exists():
                path.write_text(json.dumps(document, indent=1, allow_nan=False), encoding="utf-8")
                return path
    except OSError as exc:
        raise UsageError("file-not-written", file=str(folder), why=system_reason(exc)) from exc
    raise UsageError("msa-too-many-studies", folder=str(folder))


def _print_study(document: Mapping[str, Any]) -> None:
    methods = [k for k in ("type1", "anova", "xbar_r", "bias", "linearity") if document.get(k)]
    keys = [key for key in document[methods[0]] if key not in ("method", "intervals", "fitted")]
    rows = [(key, *(_format_figure(document[m], key) for m in methods)) for key in keys]
    _output.print_table("", TextTable(("", *methods), rows))
    for at in document.get("linearity", {}).get("fitted", ()):
        figures = (_format_value(at[key]) for key in ("reference", "mean", "fitted", "half"))
        _output.print_message(
            Message("msa-bias-at", **dict(zip(("reference", "mean", "fitted", "half"), figures, strict=True)))
        )
    _output.print_line(f"{document['study']} of {document['value']}: {document['judgement']}")


def _format_figure(figures: Mapping[str, Any], key: str) -> str:
    """A figure, and behind it its confidence interval where the method gives one."""
    interval = (figures.get("intervals") or {}).get(key)
    value = _format_value(figures[key])
    return value if interval is None else f"{value}  ({_format_value(interval[0])} … {_format_value(interval[1])})"


def _format_value(value: Any) -> str:
    return "–" if value is None else str(value) if isinstance(value, int) else f"{value:.5g}"
