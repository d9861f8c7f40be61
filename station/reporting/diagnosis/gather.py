"""From a diagnosis to what its report shows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from station.diagnosis.data.reduce import ReducedScene, mean_and_contrasts
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.results.line_impact import cause_contribution, new_causes
from station.diagnosis.results.smallest_effect import smallest_detectable
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.forward import resting_stimulus
from station.model.scene import COVARIATES, Scene, scene_of_table
from station.reporting.diagnosis import clock_course, samples
from station.reporting.diagnosis.data import CauseSignature, DwellCourse, ReportData
from station.reporting.diagnosis.formula_curve import formula_curves

#: Covariates that a picture can have as its horizontal axis.
AXIS_COVARIATES = ("temperature_degC", "temperature_rate", "since_power_s", "since_clamp_s", "motor")
#: Labels of visits that a samples table may carry.
VISIT_LABELS = ("station", "nest", "lot", "operator", "gold")


def report_data(d: Diagnosis, document: Mapping[str, Any]) -> ReportData:
    """The diagnosis as the report has it."""
    view, first = d.last.view, d.search_result.first.view
    scene, visits, known = view.scene, view.scene.visits, d.recipe.pose_known
    effects = [cause_contribution(d.last, i) for i in new_causes(d)]
    faults = {f.effect for f in d.inspection.faults}
    read, expected = _read_and_expected(d) if d.inspection.faults and known else (None, None)
    return ReportData(
        document=document,
        recipe=d.recipe.name,
        axes=("x", "y", "z") if known else ("along the stimulus",),
        unit=visits.unit,
        position=visits.position,
        run=visits.run,
        visit=visits.visit,
        previous=visits.previous,
        values={"time_s": scene.time_s} | {k: v for k in AXIS_COVARIATES if (v := getattr(scene, k)) is not None},
        measured=_projected(view, view.reduced.mean),
        before=_projected(first, first.reduced.mean - first.simulated()[0]),
        after=_projected(view, view.reduced.mean - view.simulated()[0]),
        signatures=tuple(
            CauseSignature(
                d.last.accepted[i].candidate.name, _without_calibration(d.last, mean), _projected(view, mean)
            )
            for i, (mean, _) in zip(new_causes(d), effects, strict=True)
        ),
        dwell=_dwell_course(d, effects) if known and any(np.any(c) for _, c in effects) else None,
        read=read,
        expected=expected,
        smallest=smallest_detectable(d.search_result.stage, d.search_result.share),
        felt=resting_stimulus(scene, view.active) if known else None,
        told=None if known else resting_stimulus(scene, view.active),
        groups=dict(visits.groups),
        spectrum=samples.tone_spectrum(d.inspection.table) if "motor-tone" in faults else None,
        samples={f.effect: samples.first_dwell(d.table, f) for f in d.inspection.faults},
        clock=clock_course.of(d.recipe, d.table, d.inspection.faults),
        curves=formula_curves(d) if known else (),
        recorded=frozenset(name for name in (*COVARIATES, *VISIT_LABELS) if scene.is_recorded(name)),
    )


def _projected(view: ResidualView, readings: Floats) -> Floats:
    return np.asarray(np.einsum("vki,vi->vk", view.own, readings))


def _without_calibration(problem: ScoringProblem, effect: Floats) -> Floats:
    """An effect (v, k) without what each unit's calibration takes up of it, by least squares."""
    view = problem.view
    columns = np.einsum("vki,vip->vkp", view.own, view.calibration(problem.matrix))
    projected, unit = _projected(view, effect), view.scene.visits.unit.code
    remaining = np.empty_like(projected)
    for u in range(len(view.base.offset)):
        rows = unit == u
        A, y = columns[rows].reshape(-1, columns.shape[2]), projected[rows].ravel()
        remaining[rows] = (y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0]).reshape(-1, projected.shape[1])
    return remaining


def _dwell_course(d: Diagnosis, effects: list[tuple[Floats, Floats]]) -> DwellCourse:
    """The mean course within a dwell, visits and axes weighted and turned by how strongly the causes begin there."""
    problem, r = d.last, d.last.view.reduced
    mean, contrast = (sum(parts[1:], parts[0]) for parts in zip(*effects, strict=True))
    predicted = _blocks(r, mean, contrast)
    now = problem.view.simulated()
    remaining = _blocks(r, r.mean - now[0] + mean, r.contrast - now[1] + contrast)
    weight = predicted[:, 0] - predicted[:, -1]
    total = max(float(np.abs(weight).sum()), 1e-300)
    level = [np.einsum("vbi,vi->b", part - part[:, -1:], weight / total) for part in (remaining, predicted)]
    ends = np.append(0.0, r.edges)
    middles = samples.usual_dwell_s(next(iter(d.inspection.samples.portions()))) * (ends[1:] + ends[:-1]) / 2
    rest = _blocks(r, r.mean - now[0], r.contrast - now[1])
    scatter = np.nanmean((rest - rest[:, -1:]) ** 2, axis=(0, 2))
    std = np.sqrt(scatter * float(np.sum((weight / total) ** 2)))
    return DwellCourse(middles, level[0], level[1], std, np.sqrt(scatter))


def _blocks(r: ReducedScene, mean: Floats, contrast: Floats) -> Floats:
    """Values of the sub-blocks (v, B, 3), from means and contrasts."""
    v, B = r.count.shape
    row, rest = mean_and_contrasts(np.broadcast_to(np.eye(B), (v, B, B)), r.count)
    forth = np.concatenate([row[:, None], rest], axis=1)
    predicted = np.concatenate([mean[:, None], contrast], axis=1)
    return np.asarray(np.linalg.pinv(forth) @ predicted)


def _read_and_expected(d: Diagnosis) -> tuple[Floats, Floats]:
    """Means of the samples as they came (v, 3), and what an ideal unit would read there."""
    scene: Scene = scene_of_table(d.recipe, d.table)
    count = np.bincount(scene.visit)
    read = np.stack([np.bincount(scene.visit, column) / count for column in d.table.reading.T], axis=1)
    v = scene.visits
    true = np.einsum("vji,vj->vi", np.einsum("vij,vjk->vik", v.nest_R, v.seat_R), v.stimulus)
    return read, true
