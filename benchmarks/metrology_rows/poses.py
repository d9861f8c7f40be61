"""Coverage where the rig is off: nest, base, poses, gravity, stated or not, and after units in the log."""

from dataclasses import replace

import numpy as np
from metrology_rows.bench import FLOOR, NARROW, Bench
from metrology_rows.designs import DEG, MEAN_NOISE, Floats, recipe
from metrology_rows.report import Report
from metrology_rows.risks import past

from station.domain.core.types import Labels, SampleTable
from station.domain.line_quality import history


def white(units: int, report: Report) -> None:
    """Nothing but white noise, everything else stated as nothing."""
    for design in ("six", "n18", "norm", "three"):
        bench = Bench(recipe(design, {"pose_std_deg": 0} if design == "three" else {}), units, report, 10)
        if design == "three":
            bench.matrix = bench.matrix * np.eye(3)
            bench.recipe = recipe(design, {"pose_std_deg": 0}, device={"rounding": "nearest", "cross_std": 0})
        bench.coverage(f"white noise, {design}", bench.readings(bench.truth()), (0.94, 0.975))


def tilts(units: int, report: Report) -> None:
    """Nest and base off by 0.1°, stated as such."""
    for design in ("six", "n18", "norm"):
        for name in ("nest", "base", "nest and base"):
            stated = {f"{part}_std_deg": 0.1 for part in ("nest", "base") if part in name}
            bench = Bench(recipe(design, stated), units, report, 20)
            size = {part: 0.1 * DEG for part in ("nest", "base") if part in name}
            bench.coverage(f"{name} tilt 0.1° stated, {design}", bench.readings(bench.truth(**size)), NARROW)


def taught(units: int, report: Report) -> None:
    """Six faces where the log has 100 units of the kind: what their residuals were narrows U."""
    angle = 0.1 * DEG
    for seed in (25, 26):
        for name, stated, size in (
            ("white noise", {}, {}),
            ("nest tilt 0.1° stated", {"nest_std_deg": 0.1}, {"nest": angle}),
            ("base tilt 0.1° stated", {"base_std_deg": 0.1}, {"base": angle}),
            ("poses 2 × noise of a mean", {}, {"pose": 2 * MEAN_NOISE}),
        ):
            of = recipe("six", stated)
            first = Bench(of, 100, report, seed + 1000)
            earlier = enumerate(first.results(first.readings(first.truth(**size))))
            known = history.learn_history([past(r, i) for i, r in earlier], np.ones(12, bool), ())
            bench = Bench(known.applied(of), units, report, seed)
            goal = FLOOR if "pose" in size else NARROW
            bench.coverage(f"{name}, six, after 100 units", bench.readings(bench.truth(**size)), goal)


class TwiceBench(Bench):
    """A bench whose units go through their poses twice."""

    def table(self, readings: Floats) -> SampleTable:
        """As a samples table of two runs."""
        table, poses = super().table(readings), len(self.poses)
        visit = table.visit % poses
        return replace(table, run=table.visit // poses, visit=visit, position=Labels(table.position.names, visit))


def runs(units: int, report: Report) -> None:
    """Offsets of 0.5 mg from power-on to power-on, stated, poses visited in two runs."""
    for design in ("six", "n18", "norm"):
        bench = TwiceBench(recipe(design, device={"turn_on_std": 5e-4}, runs=[{}, {}]), units, report, 45)
        values = bench.readings(np.tile(bench.truth(), (1, 2, 1)))
        apart = 5e-4 * bench.rng.standard_normal((units, 2, 1, 3))
        values += np.repeat(apart, len(bench.poses), axis=1).reshape(units, -1, 1, 3)
        bench.coverage(f"offsets of two runs stated, {design}", values, (0.94, 0.975))


def poses(units: int, report: Report) -> None:
    """Poses off by what nobody stated."""
    for design in ("six", "n18", "norm"):
        for factor in (1, 2, 3):
            bench = Bench(recipe(design), units, report, 30 + factor)
            true = bench.truth(pose=factor * MEAN_NOISE)
            bench.coverage(f"poses {factor} × noise of a mean, {design}", bench.readings(true), FLOOR)
    bench = Bench(recipe("n18", {"pose_std_deg": 1.0}), units, report, 39)
    bench.coverage("poses 1° stated, n18", bench.readings(bench.truth(pose=DEG)), NARROW)
    for kind, name in ((Bench, "once"), (TwiceBench, "twice")):
        runs: list[dict[str, str]] = [{}] if kind is Bench else [{}, {}]
        bench = kind(recipe("n18", {"pose_std_deg": 0.3}, runs=runs), units, report, 38)
        values = bench.readings(np.tile(bench.truth(pose=0.3 * DEG), (1, len(runs), 1)))
        values += 10 * MEAN_NOISE * bench.rng.standard_normal((*values.shape[:2], 1, 3))
        bench.coverage(f"poses .3° stated, other scatter of 10 × noise, visited {name}", values, FLOOR)
    for factor in (10, 100, 300):
        bench = Bench(recipe("six", {"pose_std_deg": 0.3}), units, report, 37)
        values = bench.readings(bench.truth(pose=0.3 * DEG))
        values += factor * MEAN_NOISE * bench.rng.standard_normal((*values.shape[:2], 1, 3))
        bench.coverage(f"the same, {factor} × noise, six faces visited once", values, FLOOR)


def sites(units: int, report: Report) -> None:
    """Gravity of the equator under a recipe that says nothing of its site."""
    bench = Bench(recipe("six", {"magnitude_std": None}), units, report, 70)
    bench.coverage("equator, site not stated, six", bench.readings(bench.truth(size=0.997316)), FLOOR)
