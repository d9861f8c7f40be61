"""Row 8: two causes hidden at once, each at d = 12."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from diagnosis_rows.figures import Array, Figure, at_least, share
from diagnosis_rows.trials import Request, Trial, shown

from tests.blind.bench import WHITE, Hidden, Scaled, World, hide, strength
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe

EACH = 12.0
#: Pairs that this recipe itself leaves tied below d = 13, by the table of what it tells apart.
TIED = ({"quadratic", "asymmetry"}, {"settling", "filter-lag"}, {"base-tilt", "index-error"})


def at_strength(hidden: Hidden, d: float) -> Hidden:
    """The same, at strength d in a white floor."""

    def scaled(w: World, rng: Any) -> tuple[Array, Array]:
        size, stored = 1.0, rng.bit_generator.state
        for _ in range(4):
            rng.bit_generator.state = stored
            sized = Scaled(rng.bit_generator)
            sized.size = size
            felt, added = hidden(w, sized)
            size *= d / strength(w, felt, added, WHITE.density)
        return felt, added

    return scaled


def both(one: Hidden, other: Hidden) -> Hidden:
    """Both at once: small turns add."""

    def hidden(w: World, rng: Any) -> tuple[Array, Array]:
        (felt, added), (felt_2, added_2) = one(w, rng), other(w, rng)
        return felt + felt_2 - w.a, added + added_2

    return hidden


def drawn(seed: int, count: int) -> list[tuple[str, str]]:
    """Pairs of causes, drawn at random."""
    rng = np.random.default_rng(seed)
    found: list[tuple[str, str]] = []
    while len(found) < count:
        one, other = (str(x) for x in rng.choice(sorted(KNOWN), 2, replace=False))
        if {one, other} not in TIED:
            found.append((one, other))
    return found


def two(seed: int, sets: int) -> list[Figure]:
    """Row 8."""
    trials: list[tuple[tuple[str, str], Trial]] = []
    for n, pair in enumerate(drawn(seed, 16 * sets)):
        request = Request(" and ".join(pair), "white", seed * 10**6 + 700_000 + n, d=EACH)
        one, other = (at_strength(KNOWN[name], EACH) for name in pair)
        table, truth = hide(recipe(), both(one, other), request.seed)
        trials.append((pair, shown(request, diagnosis_of(recipe(), table), truth)))
    for pair, t in trials:
        if not _exact(pair, t):
            print(f"    {t.miss()}", flush=True)
    recall = [name in _members(t.sets) for pair, t in trials for name in pair]
    return [
        share("two at once, d = 12: both named", [_both(p, t) for p, t in trials], lambda p: at_least(p, 0.90)),
        share("  both and nothing else", [_exact(p, t) for p, t in trials]),
        share("  one of them named", recall),
    ]


def _members(sets: Sequence[Sequence[str]]) -> set[str]:
    return {name for s in sets for name in s}


def _both(pair: tuple[str, str], t: Trial) -> bool:
    """Whether each of the pair stands in a set of its own."""
    one, other = ([i for i, s in enumerate(t.sets) if name in s] for name in pair)
    return any(i != j for i in one for j in other)


def _exact(pair: tuple[str, str], t: Trial) -> bool:
    return _both(pair, t) and len(t.sets) == 2 and t.verdict == "named"
