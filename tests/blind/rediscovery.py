"""Each cause of the library that moves means, at its usual size, found again as a formula by a station without it."""

from collections.abc import Mapping

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.discovery.discover import Discovery, ThresholdOf, discover
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.recipes import recipe

Families = frozenset[tuple[str, str]]


def _families(*names: str) -> Families:
    return frozenset((one, two) for one, _, two in (name.partition("·") for name in names))


#: The form of each as the grammar writes it; more than one where two are the same on these visits.
FORMS: Mapping[str, Families] = {
    "cross-axis": _families("other·constant"),
    "package-rotation": _families("other·constant", "turn-device·constant"),
    "nest-tilt": _families("turn-nest·constant", "turn-device·constant", "other·constant"),
    "base-tilt": _families("turn-station·constant"),
    "index-error": _families("turn-nest·constant", "one·constant"),
    "quadratic": _families("own-squared·constant"),
    "cubic": _families("own-cubed·constant", "own-signed-square·constant", "own-dead-band·constant"),
    "asymmetry": _families("own-size·constant"),
    "cross-quadratic": _families("own-other·constant"),
    "offset-temperature": _families("one·temperature"),
    "gain-temperature": _families("own·temperature"),
    "temperature-rate": _families("one·temperature-rate"),
    "warm-up": _families("one·decay-since-power", "one·creep-since-power"),
    "bias-drift": _families("one·time"),
    "hysteresis": _families("step·constant"),
    "settling": _families("step·decay-since-arrival"),
    "filter-lag": _families("step·decay-since-arrival"),
    "lever-arm": _families("one·decay-since-arrival"),
    "clamp-creep": _families("one·creep-since-clamp"),
    "vibration-rectification": _families("one·motor-squared"),
    "turn-on-offset": _families("one·constant"),
}


def rediscover(name: str, seed: int, threshold_of: ThresholdOf | None = None) -> Discovery:
    """The formula found where a cause of the library acts at its usual size, and no cause is known."""
    kind = recipe()
    units = ("A", "B", "C", "D")
    table = simulate(SimulationJob(kind, units, seed, parse_effects((name,), kind))).table
    problem = initial_problem(reduce_samples(kind, table), FloorAllowance.of(kind, Model()))
    return discover(problem, None, seed, threshold_of)


def is_rediscovered(name: str, found: Discovery) -> bool:
    """Whether one of the formulas given as one has its form."""
    terms = [f.term.family for t in found.terms[:1] for f in (t.fit, *t.equivalent)]
    return bool(FORMS[name] & set(terms))
