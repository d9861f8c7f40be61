"""The run's own path over a recorded log: the same frames, checks, calibration and verdict; nothing is written."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from station.domain.capture.annotations import Annotation, Annotations, captured_visits
from station.domain.capture.visit import Visit
from station.domain.capture.visit_check import check
from station.domain.core.types import Frames, NestAssignment, Outcome, Reason, SampleTable, Verdict
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.recipe import plan
from station.errors import LogError
from station.messages import Value
from station.service.compute import decode_visits, refit, samples_of
from station.service.station import Job


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedUnit:
    """One unit of a log. reasons: of bad visits, then of the verdict; seat.nest is '' where nobody knows it; attempt:
    its id, where the log has several of the unit, or ''."""

    seat: NestAssignment
    result: CalibrationResult
    outcome: Outcome
    reasons: tuple[Reason, ...]
    noise: float | None
    duration_s: float
    attempt: str = ""


def replay(frames: Frames, marks: Annotations, job: Job) -> Iterator[ReplayedUnit]:
    """Every unit of a log, one after the other. Errors: LogError when a mark lies outside the log or the recipe."""
    for (seat, attempt), visits, table in _units(frames, marks, job):
        bad = tuple(reason for visit in visits for reason in _check(visit, job))
        result = refit(table, job.recipe, job.product, int(frames.time_ns[0]))
        yield replace(_replayed_unit(seat, result, bad, visits), attempt=attempt)


def tables(frames: Frames, marks: Annotations, job: Job) -> Iterator[SampleTable]:
    """The uncalibrated samples of every unit of a log; `nest` says at which node it answered. Errors: as `replay`."""
    return (table for _, _, table in _units(frames, marks, job))


def _units(
    frames: Frames, marks: Annotations, job: Job
) -> Iterator[tuple[tuple[NestAssignment, str], list[Visit], SampleTable]]:
    """Every unit, by seat and attempt, with its marked visits, and the samples of those that it is calibrated by."""
    for own in marks.units().values():
        serial = own[0].unit
        seat = NestAssignment(serial, "", own[0].node)
        _check_marks(own, frames, job)
        visits = decode_visits(seat.node, captured_visits(own, frames), job.recipe, job.layout)
        labels = {"nest": f"node-{seat.node}"}
        table = samples_of(seat, [v for v in visits if _is_tumble(v, job)], job.recipe, job.layout, labels)
        if not len(table):
            raise LogError("marks-without-readings", serial=serial, node=seat.node)
        yield (seat, own[0].attempt), visits, table


def _check_marks(marks: Sequence[Annotation], frames: Frames, job: Job) -> None:
    lasts_s = (int(frames.time_ns[-1]) - int(frames.time_ns[0])) / 1e9
    known = {p.name for p in (*job.recipe.positions, *job.recipe.verify.positions)}
    for mark in marks:
        where: dict[str, Value] = {"serial": mark.unit, "run": mark.run, "visit": mark.visit}
        if not mark.start_s < mark.end_s or mark.end_s < 0 or mark.start_s > lasts_s:
            raise LogError("mark-outside-log", start_s=mark.start_s, end_s=mark.end_s, lasts_s=lasts_s, **where)
        if job.recipe.pose_known and mark.position not in known:
            raise LogError("mark-of-unknown-position", position=mark.position, recipe=job.recipe.name, **where)


def _is_tumble(visit: Visit, job: Job) -> bool:
    return not job.recipe.pose_known or visit.position in {p.name for p in job.recipe.positions}


def _check(visit: Visit, job: Job) -> tuple[Reason, ...]:
    """The checks of a live visit; what only a live bus tells (drops, heartbeat) a log cannot say."""
    recipe = job.recipe
    visits = plan.planned_visits(recipe, visit.run % len(recipe.runs)) if recipe.pose_known else ()
    true = {s.position: s.true for s in visits}
    return check(visit, true[visit.position], recipe, job.layout) if visit.position in true else ()


def _replayed_unit(
    seat: NestAssignment, result: CalibrationResult, bad: tuple[Reason, ...], visits: Sequence[Visit]
) -> ReplayedUnit:
    verdict: Verdict = result.verdict
    outcome = Outcome.FAIL if bad and verdict.outcome is Outcome.PASS else verdict.outcome
    noise = None if result.visits is None else float(result.visits.std.max())
    duration_s = (visits[-1].to_ns - visits[0].from_ns) / 1e9
    return ReplayedUnit(seat, result, outcome, (*bad, *verdict.reasons), noise, duration_s)
