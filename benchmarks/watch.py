"""What the watch promises, and what it does: `python benchmarks/watch.py [--loads 20000] [--changes 40] [--seed 1]`.

With `--lasting N`, N of the places change after 1,000 loads and stay so: what a load costs with open alerts. With
`--mended N`, every N loads all places change for 50 loads and are put right: what alerts cost that begin and end.

Values are drawn, not simulated: a bank as of a six-point line with four nests (69 streams), the units' scatter
Student's t with 5 degrees of freedom, or normal. A delay counts loads from the change to the first alert of its
beginning that bears the right name. Two peers, both CUSUMs of the exact likelihood ratio, told the form of the change:
baseline, distribution, direction and size. Both give one false alarm in 1,000 loads:

* not told the place: one CUSUM for each stream, up and down, and 1,000 loads for all of them, as for the watch. No
  watch of so many streams can be much faster (each stream may alarm 2 · 69 times as seldom only);
* told the place, too: one CUSUM, which needs no name.
"""

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats

from station.domain.core.types import Floats
from station.domain.watch.bank import DEFAULT_RUN_LENGTH, LoadValues, WatchBank, WatchedPlace
from station.domain.watch.signals import WatchedSignal

#: Components of each signal: per nest, and of the station.
_OF_NEST = {"nest-tilt": 3, "offset": 3, "gain": 3, "residual": 1, "noise": 1}
_POSITIONS, _NESTS = 6, "ABCD"
_FREEDOM = 5
_CHANGED = WatchedPlace(WatchedSignal("nest-tilt"), "B")
_TOTAL = 8.0
_LEARNT = 1000
#: Standard deviations of a change that lasts.
_LASTING = 2.0
#: Loads of a change that is put right.
_MENDED_AFTER = 50
#: States of a CUSUM, and points of a distribution, in the computation of its run length.
_STATES, _POINTS = 400, 200_000


@dataclass(frozen=True)
class Scatter:
    """How units scatter, standard deviation 1. freedom: of Student's t, None: normal."""

    freedom: int | None

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """count values."""
        if self.freedom is None:
            return rng.standard_normal(count)
        return np.asarray(math.sqrt((self.freedom - 2) / self.freedom) * rng.standard_t(self.freedom, count))

    def nats(self, values: Floats, shift: float) -> Floats:
        """Log likelihood ratio of values with a shift against without."""
        law = self._law()
        return np.asarray(law.logpdf(values - shift) - law.logpdf(values))

    def quantiles(self) -> Floats:
        """Points of equal probability."""
        return np.asarray(self._law().ppf((np.arange(_POINTS) + 0.5) / _POINTS))

    def _law(self) -> "stats.rv_frozen":
        if self.freedom is None:
            return stats.norm()
        return stats.t(self.freedom, scale=math.sqrt((self.freedom - 2) / self.freedom))


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loads", type=int, default=20_000)
    parser.add_argument("--changes", type=int, default=40)
    parser.add_argument("--size", type=float, action="append", help="standard deviations a load: 1, 2 and 4")
    parser.add_argument("--normal", action="store_true", help="normal scatter in place of Student's t")
    parser.add_argument("--lasting", type=int, default=0, help="changes that last through the quiet loads")
    parser.add_argument("--mended", type=int, default=0, help="loads from one change of all places to the next")
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    scatter = Scatter(None if wanted.normal else _FREEDOM)
    print(f"seed {wanted.seed}, {'normal' if wanted.normal else f'Student t of {_FREEDOM} degrees of freedom'}")
    if wanted.loads:
        _quiet(wanted.loads, wanted.seed, scatter, wanted.lasting, wanted.mended)
    for size in (wanted.size or (1.0, 2.0, 4.0)) if wanted.changes else ():
        _changes(size, wanted.changes, wanted.seed, scatter)


def _places() -> dict[WatchedPlace, int]:
    found = {WatchedPlace(WatchedSignal(kind), nest): m for nest in ("", *_NESTS) for kind, m in _OF_NEST.items()}
    found[WatchedPlace(WatchedSignal("base-tilt"))] = 2
    return found | {WatchedPlace(WatchedSignal("index-error", f"p{i}")): 2 for i in range(_POSITIONS)}


def _loads(rng: np.random.Generator, scatter: Scatter, numbers: range, shift: float = 0.0) -> Iterator[LoadValues]:
    places = _places()
    for number in numbers:
        values = {p: scatter.draw(rng, m) for p, m in places.items()}
        values[_CHANGED][0] += shift
        yield LoadValues(number, values)


def _quiet(loads: int, seed: int, scatter: Scatter, lasting: int, mended: int) -> None:
    """Loads without a change, or with some; each alert that lasts is estimated anew after each load, as by --follow."""
    rng, bank, raised, ended = np.random.default_rng(seed), WatchBank(), 0, 0
    places, spent = list(_places()), []
    for load in _loads(rng, scatter, range(1, loads + 1)):
        everywhere = mended and load.number > mended and load.number % mended < _MENDED_AFTER
        for place in places if everywhere else places[:lasting] if load.number > _LEARNT else ():
            load.values[place][0] += _LASTING
        began = time.process_time()
        found = bank.add(load)
        for alert in bank.open:
            bank.refresh(alert)
        spent.append(time.process_time() - began)
        raised, ended = raised + len(found[0]), ended + len(found[1])
    part = max(1, loads // 10)
    early, late = np.median(spent[:part]) * 1e3, np.median(spent[-part:]) * 1e3
    print(f"{loads} loads, {bank.components} streams, ", end="")
    if lasting or mended:
        print(f"{lasting} changes that last, {mended and (loads - 1) // mended} put right: {raised} alerts", end="")
    else:
        print(f"all quiet: {raised} false alarms, {raised / loads * 1000:.3f} per 1,000 (goal at most 1)", end="")
    print(f", {ended} ended; a load costs {early:.2f} ms of processor at first, {late:.2f} ms at last", end="")
    most = int(np.argmax(spent))
    print(f", {spent[most] * 1e3:.0f} ms at most, load {most + 1} (goal 300 ms, flat); all {sum(spent):.0f} s")


def _changes(size: float, changes: int, seed: int, scatter: Scatter) -> None:
    """A change of `size` standard deviations in one component after 1,000 quiet loads, until it amounts to d = 8."""
    most = math.ceil((_TOTAL / size) ** 2)
    streams = sum(_places().values())
    nats = np.sort(scatter.nats(scatter.quantiles(), size))
    told, untold = (_limit(nats, DEFAULT_RUN_LENGTH * k) for k in (1, 2 * streams))
    alarms, names, alone, banks, near, held, named = list[int](), list[int](), list[int](), list[int](), 0, 0, 0
    for change in range(changes):
        rng = np.random.default_rng([seed, int(size * 100), change])
        bank = WatchBank()
        for load in _loads(rng, scatter, range(1, _LEARNT + 1)):
            bank.add(load)
        loads = list(_loads(rng, scatter, range(_LEARNT + 1, _LEARNT + 1 + max(most, 100)), size))
        ratios = scatter.nats(np.array([load.values[_CHANGED][0] for load in loads]), size)
        alone.append(_cusum(ratios, told))
        banks.append(_cusum(ratios, untold))
        alarm, name = _delays(bank, loads)
        alarms.append(alarm)
        names.append(name)
        bank = _since(bank, loads[name:most])
        for alert in (a for a in bank.open if _is_right(a.begin)):
            bank.refresh(alert)
            near += abs(alert.begin - _LEARNT - 1) <= 2
            held += alert.low <= _LEARNT + 1 <= alert.high
            named += alert.place == _CHANGED
            break
    alarmed, watch, peer, many = (float(np.mean(found)) for found in (alarms, names, alone, banks))
    error = float(np.std(names)) / math.sqrt(changes)
    print(
        f"change of {size:g} σ a load, {changes} times, d = 8 after {most} loads: mean delay to an alert {alarmed:.2f}"
        f", to the right name {watch:.2f} ± {error:.2f}"
    )
    print(f"  CUSUMs told the form, not the place {many:.2f}, ratio {watch / many:.2f} (goal 1.3);", end="")
    print(f" told the place, too {peer:.2f}, ratio {watch / peer:.2f} (least possible {many / peer:.2f})")
    print(f"  beginning within 2 loads {near / changes:.2f} (goal .9; told both levels", end="")
    print(f" {_best_beginning(size, most, scatter, seed):.2f}), its 95 % span holds {held / changes:.2f};", end="")
    print(f" right name {named / changes:.2f}")


def _delays(bank: WatchBank, loads: list[LoadValues]) -> tuple[int, int]:
    """Loads until the change is alarmed, and until an alert of it bears its name; all of them where that never is."""
    alarm = len(loads)
    for i, load in enumerate(loads, 1):
        bank.add(load)
        for alert in (a for a in bank.open if _is_right(a.begin)):
            alarm = min(alarm, i)
            bank.refresh(alert)
            if alert.place == _CHANGED:
                return alarm, i
    return alarm, len(loads)


def _since(bank: WatchBank, loads: list[LoadValues]) -> WatchBank:
    for load in loads:
        bank.add(load)
    return bank


def _is_right(begin: int) -> bool:
    return begin > _LEARNT - 50


def _cusum(nats: Floats, limit: float) -> int:
    """Values until the CUSUM of these log likelihood ratios alarms."""
    total = 0.0
    for i, step in enumerate(nats, 1):
        total = max(0.0, total + float(step))
        if total >= limit:
            return i
    return len(nats)


def _limit(nats: Floats, run_length: float) -> float:
    """At which a CUSUM of steps that are equally likely one of `nats` (sorted) runs so long (Brook and Evans 1972)."""
    low, high = 0.1, 30.0
    for _ in range(24):
        middle = (low + high) / 2
        low, high = (middle, high) if _run_length(nats, middle) < run_length else (low, middle)
    return high


def _run_length(nats: Floats, limit: float) -> float:
    width = limit / _STATES
    starts = (np.arange(_STATES) + 0.5) * width
    starts[0] = 0.0
    edges = np.arange(1, _STATES + 1) * width
    below = np.searchsorted(nats, edges[None, :] - starts[:, None]) / len(nats)
    moves = np.diff(below, prepend=0.0, axis=1)
    return float(np.linalg.solve(np.eye(_STATES) - moves, np.ones(_STATES))[0])


def _best_beginning(size: float, most: int, scatter: Scatter, seed: int, trials: int = 1000) -> float:
    """Beginnings within 2 loads for who knows levels and distribution: the 5 loads with most of the posterior."""
    rng, before, right = np.random.default_rng([seed, 2]), 200, 0
    for _ in range(trials):
        values = scatter.draw(rng, before + most)
        values[before:] += size
        nats = np.cumsum(scatter.nats(values, size)[::-1])[::-1]
        near = np.convolve(np.exp(nats - nats.max()), np.ones(5), "same")
        right += abs(int(near.argmax()) - before) <= 2
    return right / trials


if __name__ == "__main__":
    main()
