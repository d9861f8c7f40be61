"""Rows 3, 4, 7 and 10: the right name, beside the peers; what the name gains; and the size of the set."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from diagnosis_rows import oracle, peers
from diagnosis_rows.figures import Figure, Judge, at_least, at_most, bootstrapped, share
from diagnosis_rows.same_noise import gain_of_the_true_form
from diagnosis_rows.trials import Request, Trial, named_ids, tell_misses, trial, tried

from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.results.diagnose import Diagnosis
from station.model.forward import forward
from station.model.scene import scene_of_table
from tests.blind.bench import WHITE, Floor, hide
from tests.blind.hidden import WRONG_FORM
from tests.blind.recipes import recipe

#: Goals by strength, by size and by strength.
NAMING = {8.0: 0.95, 11.0: 0.98, 16.0: 0.99}
SIZES = {1.0: 0.98, 0.5: 0.97, 0.25: 0.92}
GAIN = {8.0: 0.97, 11.0: 0.99}


@dataclass(frozen=True)
class Surveyed:
    """A trial, what the peers named, whether the omnibus test fired, and the gain: of the found model, of the true one
    on the average, and of the true one on the same noise."""

    trial: Trial
    peers: Mapping[str, str]
    omnibus: bool
    gain: float
    true_gain: float
    same_noise: float


@cache
def survey(seed: int, sets: int, d: float) -> tuple[Surveyed, ...]:
    """Every cause, and every one of another form, so many times at one strength in a white floor."""
    found = []
    for i, name in enumerate(named_ids()):
        for n in range(sets):
            request = Request(name, "white", seed * 10**6 + 400_000 + 1000 * round(d) + 40 * n + i, d=d)
            made, diagnosis = tried(request)
            found.append(
                Surveyed(
                    made, peers.named(diagnosis), peers.omnibus(diagnosis), gained(made, diagnosis),
                    oracle.form(name).gain(made.strength), gain_of_the_true_form(request, made.size),
                )
            )  # fmt: skip
    return tuple(found)


def gained(made: Trial, found: Diagnosis) -> float:
    """How much nearer to the noise-free truth the simulation comes by what was found: twice the nats that it gains
    in expectation on the samples of the same campaign measured afresh."""
    request, of = made.request, recipe(made.request.runs)
    quiet, _ = hide(of, request.hidden, request.seed, units=request.units, floor=Floor(density=1e-12), size=made.size)
    scene = scene_of_table(of, quiet)
    sigma = WHITE.density * np.sqrt(of.device.rate_hz / 2)

    def off(view: ResidualView) -> float:
        return float(np.sum((quiet.reading - forward(scene, view.base, view.active)) ** 2) / sigma**2)

    return off(found.search_result.first.view) - off(found.last.view)


def naming(seed: int, sets: int) -> list[Figure]:
    """Row 3."""
    figures = []
    for d, goal in NAMING.items():
        all_of = survey(seed, sets, d)
        observed = [s for s in all_of if s.trial.alarmed]
        figures += _of([s.trial for s in all_of], f"d = {d:g}", partial(at_least, goal=goal))
        for peer in all_of[0].peers:
            right = [s.peers[peer] == s.trial.request.right for s in observed]
            figures.append(share(f"  {peer} names first", right))
        figures.append(share("  omnibus χ² fires", [s.omnibus for s in all_of]))
    return figures


def _of(trials: list[Trial], where: str, judge: Judge) -> list[Figure]:
    """Detection and naming of trials."""
    observed = [t for t in trials if t.alarmed]
    tell_misses(trials, [t.leads for t in trials])
    return [
        share(f"{where}: named, given detection", [t.among for t in observed], judge, "leads or in its set"),
        share("  leads alone or with its set", [t.leads for t in observed]),
        share("  detected", [t.alarmed for t in trials]),
    ]


def sizes(seed: int, sets: int) -> list[Figure]:
    """Row 4."""
    figures = []
    for j, (size, goal) in enumerate(SIZES.items()):
        asks = [
            Request(name, "full", seed * 10**6 + 500_000 + 10_000 * j + 40 * n + i, size=size)
            for i, name in enumerate(named_ids())
            for n in range(sets)
        ]
        figures += _of([trial(a) for a in asks], f"usual size × {size:g}", partial(at_least, goal=goal))
    return figures


def gain(seed: int, sets: int) -> list[Figure]:
    """Row 7."""
    figures = []
    for d, goal in GAIN.items():
        observed = [s for s in survey(seed, sets, d) if s.trial.alarmed]
        for s in observed:
            if s.gain < 0.85 * s.true_gain:
                print(f"    {s.gain:.0f} of {s.true_gain:.0f}: {s.trial.miss()}")
        own, other = ([s for s in observed if (s.trial.request.name in WRONG_FORM) == wrong] for wrong in (False, True))
        what = f"gain on fresh data ÷ that of the true model, d = {d:g}"
        figures.append(_ratio(what, own, partial(at_least, goal=goal)))
        figures.append(_ratio("  ÷ that of the true model on the same noise", own, same_noise=True))
        figures.append(_ratio("  where the true form is not in the library", other))
    return figures


def _ratio(what: str, of: list[Surveyed], judge: Judge | None = None, *, same_noise: bool = False) -> Figure:
    """Gain found over gain of the true model, both summed."""
    rows = np.array([(s.gain, s.same_noise if same_noise else s.true_gain) for s in of])
    return bootstrapped(what, lambda at: float(rows[at, 0].sum() / rows[at, 1].sum()), len(rows), judge)


def set_size(seed: int, sets: int) -> list[Figure]:
    """Row 10."""
    observed = [s.trial for s in survey(seed, sets, 8.0) if s.trial.alarmed]
    size, shown = (
        np.array([len(x) for x in of], float) for of in ([t.likely for t in observed], [t.first for t in observed])
    )
    return [
        bootstrapped("causes in the 95 % set at d = 8", lambda at: float(size[at].mean()), len(size), _at_most_22),
        share("  it holds the right one", [t.request.right in t.likely for t in observed], lambda p: at_least(p, 0.95)),
        bootstrapped("  causes reported as not separable", lambda at: float(shown[at].mean()), len(shown)),
    ]


def _at_most_22(x: float) -> tuple[str, bool]:
    return at_most(x, 2.2)
