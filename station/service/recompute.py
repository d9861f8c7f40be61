"""Calibrates attempts again from the raw frames in the log, by the code that the run itself uses."""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.visit import CapturedVisit
from station.domain.core import arithmetic
from station.domain.core.types import Frames, NestAssignment
from station.domain.evaluation import calibration_document
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.line_quality import history
from station.domain.methods import uncertainty
from station.domain.noise import noise_document
from station.domain.product import product_record
from station.domain.product.product import Product
from station.domain.recipe.recipe import Recipe
from station.domain.records import plain_json, stored_attempt
from station.domain.records.framepack import plain as raw
from station.errors import LogError
from station.ports.log_reader import Attempt, LogReader
from station.service import compute

#: Parts of a calibration that are words about its numbers: a later version may say them otherwise.
_WORDS = frozenset({"reasons", "messages", "checks", "notes", "note_messages", "rule", "arithmetic"})

#: What the rules of the budget decide: those of another edition give another uncertainty, and may give another verdict.
_BY_RULES = frozenset(
    {"covariance", "budget", "false_accept", "false_reject", "outcome", "rules", "residuals", "decisions"}
)

#: Largest deviation that the arithmetic of another processor explains, in units of the largest value of the same name.
#: Linear algebra sums in the order that suits a processor; the solvers amplify the last bit to 1e-10 at most.
ROUNDING = 1e-9


_PLACE = re.compile(r"\[\d+\]")


@dataclass(frozen=True, slots=True)
class Recomputed:
    """What came out. compared: how many values of the stored calibration, those without its budget where that was made
    by rules of another edition (docs/decisions/0038-uncertainty.md); differences: those not the same bits; deviation:
    the largest of them in units of the largest value of the same name, None where they differ in more than numbers;
    same_arithmetic: whether the record says that it was made by an arithmetic such as this computer's.

    skipped: why there was nothing to compare, or ''.
    """

    attempt: str
    serial: str
    compared: int
    differences: tuple[str, ...]
    skipped: str = ""
    deviation: float | None = 0.0
    same_arithmetic: bool = False

    @property
    def identical(self) -> bool:
        """Whether every value is bit for bit the stored one."""
        return not self.differences

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than the rounding of another processor, where it was another's."""
        if self.same_arithmetic:
            return self.identical
        return self.deviation is not None and self.deviation <= ROUNDING

    def document(self) -> dict[str, Any]:
        """As `audit --recompute --json` prints it."""
        return asdict(self) | {"identical": self.identical, "agrees": self.agrees}


def recompute(reader: LogReader, attempt: Attempt) -> Recomputed:
    """Refits one attempt and compares. Errors: LogError where its record cannot be read."""
    record = reader.attempt(attempt)
    stored = stored_attempt.result(record, "calibration")
    if stored is None:
        return Recomputed(attempt.attempt, attempt.serial, 0, (), "it came to no calibration")
    recipe, product, layout = parse_recipe_and_product(*reader.recipe_and_product(attempt))
    visits = stored_visits(record["visits"], reader.frames(attempt))
    result = refit_attempt(attempt, visits, recipe, (product, layout), record)
    again = json.loads(plain_json.document(calibration_document.unit(result)))
    same_rules = stored.get("rules") == uncertainty.RULES
    if not same_rules and _left_out(stored) != _left_out(again):
        return Recomputed(attempt.attempt, attempt.serial, 0, (), "rules of another edition left out other readings")
    leave = _WORDS if same_rules else _WORDS | _BY_RULES
    before, after = ({k: v for k, v in document.items() if k not in leave} for document in (stored, again))
    before, after = dict(_leaves("", before)), dict(_leaves("", after))
    names = {**before, **after}
    different = tuple(name for name in names if _bits(before.get(name, ...)) != _bits(after.get(name, ...)))
    deviation = _deviation(before, after, different)
    same = stored.get("arithmetic") == arithmetic.fingerprint()
    return Recomputed(attempt.attempt, attempt.serial, len(names), different, "", deviation, same)


def _left_out(fit: Mapping[str, Any]) -> int:
    """How many readings were left out, by the note that says so."""
    notes = (note for note in fit.get("note_messages", ()) if note["id"] == "readings-left-out")
    return sum(note["left_out"] for note in notes)


def _deviation(before: Mapping[str, Any], after: Mapping[str, Any], names: Iterable[str]) -> float | None:
    """The largest difference in units of the largest value of its name, whatever place in a list it has."""
    numbers = {name: value for name, value in before.items() if isinstance(value, float)}
    largest = dict[str, float]()
    for name, value in numbers.items():
        kind = _PLACE.sub("", name)
        largest[kind] = max(largest.get(kind, 0.0), abs(value))
    worst = 0.0
    for name in names:
        if name not in numbers or not isinstance(after.get(name), float):
            return None
        scale = largest[_PLACE.sub("", name)]
        worst = max(worst, abs(numbers[name] - after[name]) / scale if scale else math.inf)
    return worst if math.isfinite(worst) else None


@lru_cache(maxsize=16)
def parse_recipe_and_product(recipe_json: str, product_json: str) -> tuple[Recipe, Product, SensorLayout]:
    """Recipe, product and frames as an attempt used them. Errors: LogError where they were not kept."""
    if not recipe_json or not product_json:
        raise LogError("attempt-without-recipe")
    return Recipe.model_validate_json(recipe_json), *product_record.load(product_json)


def stored_visits(rows: Sequence[Mapping[str, Any]], frames: Sequence[Frames]) -> list[CapturedVisit]:
    """The tumble's visits with their raw frames, each checked against its sealed digest. Errors: LogError."""
    if len(rows) != len(frames):
        raise LogError("attempt-frames-count", visits=len(rows), frames=len(frames))
    return [_stored_visit(row, own) for row, own in zip(rows, frames, strict=True) if row["kind"] == "tumble"]


def refit_attempt(
    attempt: Attempt,
    visits: Sequence[CapturedVisit],
    recipe: Recipe,
    product: tuple[Product, SensorLayout],
    record: Mapping[str, Any],
) -> CalibrationResult:
    """The run's own computation over stored visits, on its day, with what was known of noise, process and
    reproducibility; record: the attempt's."""
    seat = NestAssignment(attempt.serial, attempt.nest, attempt.node)
    decoded = compute.decode_visits(attempt.node, visits, recipe, product[1])
    table = compute.samples_of(seat, decoded, recipe, product[1], {})
    prior = noise_document.to_prior(stored_attempt.result(record, "dwell"))
    known = history.of_document(stored_attempt.result(record, "history"))
    return compute.refit(table, known.applied(recipe), product[0], judged_ns(record), prior)


def judged_ns(record: Mapping[str, Any]) -> int:
    """When the attempt was calibrated: the due date of a gold reference is judged by that day."""
    return int(next(r["at_ns"] for r in reversed(record["results"]) if r["name"] == "calibration"))


def _stored_visit(row: Mapping[str, Any], frames: Frames) -> CapturedVisit:
    if not raw.digest_matches(frames, row["frames_sha256"]):
        raise LogError("attempt-frames-altered", number=int(row["record"]))
    statistics = row["statistics"]
    return CapturedVisit(
        run=row["run"],
        visit=row["visit"],
        position=row["position"],
        seating=row["seating"],
        arrived_ns=row["arrived_ns"],
        from_ns=statistics["from_ns"],
        to_ns=statistics["to_ns"],
        frames=frames,
    )


def _bits(value: Any) -> Any:
    return value.hex() if isinstance(value, float) else (type(value), value)


def _leaves(name: str, value: Any) -> list[tuple[str, Any]]:
    """Every number and text of a document with its path."""
    if isinstance(value, Mapping):
        return [leaf for key, part in value.items() for leaf in _leaves(f"{name}.{key}".lstrip("."), part)]
    if isinstance(value, list):
        return [leaf for i, part in enumerate(value) for leaf in _leaves(f"{name}[{i}]", part)]
    return [(name, value)]
