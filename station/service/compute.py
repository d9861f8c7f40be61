"""What a unit's kept visits come to: calibration, verdict, and the proof through its own output."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.assemble import sample_table
from station.domain.capture.visit import CapturedVisit, Visit, decode_visit
from station.domain.core.types import Floats, NestAssignment, Reason, SampleTable
from station.domain.evaluation import pipeline, verification
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.noise.noise_prior import NoisePrior
from station.domain.product import writeback
from station.domain.product.product import Product
from station.domain.recipe import references
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import utc_day
from station.service.station import Job, Station
from station.service.unit import Unit


def calibrate(unit: Unit, job: Job, station: Station, prior: NoisePrior | None) -> CalibrationResult:
    """Calibration, budget and verdict of a unit; where its samples cannot be calibrated, a verdict ERROR alone.

    prior: what was known of its noise. Errors: ReferenceOverdue.
    """
    settings = station.settings
    labels = {"station": settings.station, "nest": unit.seat.nest, "lot": settings.lot, "operator": settings.operator}
    table = samples_of(unit.seat, unit.visits, job.recipe, job.layout, labels)
    return refit(table, job.recipe, job.product, station.clock.epoch_ns(), prior)


def samples_of(
    seat: NestAssignment,
    visits: Sequence[Visit],
    recipe: Recipe,
    layout: SensorLayout,
    labels: Mapping[str, str],
) -> SampleTable:
    """The samples table of a unit's tumble, with the gold reference where it was decoded with the visits."""
    return sample_table(seat.serial, visits, layout.counter_values, labels, counter_bits=recipe.device.counter_bits)


def decode_visits(node: int, captured: Sequence[CapturedVisit], recipe: Recipe, layout: SensorLayout) -> list[Visit]:
    """Visits of a record or a recording as the run saw them, with the gold reference where the recipe has one."""
    gold = recipe.reference.gold if recipe.reference.source == "gold" else None
    return [decode_visit(visit, layout, node, None if gold is None else gold.node) for visit in captured]


def refit(
    table: SampleTable, recipe: Recipe, product: Product, measured_ns: int, prior: NoisePrior | None = None
) -> CalibrationResult:
    """Calibrates the one unit of a table as the run does; the same table gives the same bits, today or in a year.

    measured_ns: when it was measured, for the gold reference's due date; prior: what was known of its noise.
    """
    day = utc_day(measured_ns)
    (result,) = pipeline.calibrate(recipe, table, day, writeback.rounding_std(product.map), prior)
    return result


def verify(unit: Unit, job: Job, visits: Sequence[PlannedVisit]) -> tuple[tuple[Reason, ...], dict[str, Any]]:
    """Reasons against the unit's own corrected output, and the document for the record, which the unit keeps too."""
    strength = job.recipe.reference.strength()
    found = tuple(
        _verified(visit, _true(visit, planned, job), strength, unit, job)
        for visit, planned in zip(unit.verify_visits, visits, strict=True)
    )
    positions = [_document(v) for v in found]
    if job.plain is not None:
        for position, before in zip(positions, _without_model(unit, job, job.plain, found), strict=True):
            position["error_before"] = before.error
    shown: dict[str, Any] = {
        "limit": job.recipe.verify.limit,
        "unit": job.recipe.unit,
        "positions": positions,
        "decisions": [asdict(d) | {"margin": d.margin} for d in verification.verify_decisions(found, job.recipe)],
    }
    if job.compensated_causes:
        shown["takes_in"] = list(job.compensated_causes)
    unit.verification = shown
    return verification.check(found, job.recipe), shown


def _without_model(
    unit: Unit, job: Job, plain: Recipe, found: Sequence[verification.VerifiedPosition]
) -> list[verification.VerifiedPosition]:
    """What the same dwells would have come to, had the calibration not been told of the model's causes."""
    table = samples_of(unit.seat, unit.visits, plain, job.layout, {})
    now, before = unit.fit, refit(table, plain, job.product, unit.visits[0].arrived_ns)
    if now is None or now.calibration is None or before.calibration is None:
        return list(found)
    raw = [now.calibration.matrix @ v.mean + now.calibration.offset for v in found]
    return [replace(v, mean=before.calibration.correct(r), cov=None) for v, r in zip(found, raw, strict=True)]


def _true(visit: Visit, planned: PlannedVisit, job: Job) -> Floats:
    """True vector (3) at a verify visit: the recipe's, or what the gold reference says it was."""
    if visit.gold is None:
        return planned.true
    mean = visit.gold.readings.mean(axis=0, keepdims=True)
    true, _ = references.gold_vectors(job.recipe, (mean, np.zeros((1, 3, 3))), (visit.seating,))
    return np.asarray(true[0])


def _verified(visit: Visit, true: Floats, strength: float, unit: Unit, job: Job) -> verification.VerifiedPosition:
    """Mean output at a verify visit, with its forecast; the station itself corrects a product without a switch."""
    output, fit = visit.readings, unit.fit
    if fit is None or fit.calibration is None:
        return verification.VerifiedPosition(visit.position, np.asarray(output.mean(axis=0)), true, strength)
    if not job.product.map.corrects:
        output = fit.calibration.correct(output)
    cov = verification.error_covariance(fit, job.recipe, true, output)
    own = verification.measured_covariance(fit, job.recipe, (visit.position, visit.seating), true, output)
    return verification.VerifiedPosition(visit.position, np.asarray(output.mean(axis=0)), true, strength, cov, own)


def _document(v: verification.VerifiedPosition) -> dict[str, Any]:
    """A verify position for the record; its error's forecast as standard deviations of the axes."""
    std = None if v.cov is None else np.sqrt(np.diagonal(v.cov)).tolist()
    measured = {"name": v.position, "mean": v.mean.tolist(), "true": v.true.tolist(), "error": v.error}
    return {**measured, "std": v.std, "forecast_std": std, "chance": v.chance}
