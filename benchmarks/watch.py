"""What the watch promises, and what it does: `python benchmarks/watch.py [--loads 20000] [--changes 12] [--seed 1]`.

Values are drawn, not simulated: a bank as of a six-point line with four nests (69 streams), the units' scatter
Student's t with 5 degrees of freedom. The peer is a CUSUM that is told stream, direction and size of the change, and
the baseline; its threshold is Siegmund's for the same run length: of this one stream, and of as many streams, up and
down, as the watch has.
"""

import argparse
import math
import time
from collections.abc import Iterator

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch.bank import DEFAULT_RUN_LENGTH, LoadValues, WatchBank, WatchedPlace
from station.domain.watch.signals import WatchedSignal

#: Components of each signal: per nest, and of the station.
_OF_NEST = {"nest-tilt": 3, "offset": 3, "gain": 3, "residual": 1, "noise": 1}
_POSITIONS, _NESTS = 6, "ABCD"
_FREEDOM = 5
_CHANGED = WatchedPlace(WatchedSignal("nest-tilt"), "B")
_OVERSHOOT = 1.166
_TOTAL = 8.0
_LEARNT = 1000


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loads", type=int, default=20_000)
    parser.add_argument("--changes", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    print(f"seed {wanted.seed}")
    _quiet(wanted.loads, wanted.seed)
    for size in (1.0, 2.0, 4.0):
        _changes(size, wanted.changes, wanted.seed)


def _places() -> dict[WatchedPlace, int]:
    found = {WatchedPlace(WatchedSignal(kind), nest): m for nest in ("", *_NESTS) for kind, m in _OF_NEST.items()}
    found[WatchedPlace(WatchedSignal("base-tilt"))] = 2
    return found | {WatchedPlace(WatchedSignal("index-error", f"p{i}")): 2 for i in range(_POSITIONS)}


def _loads(rng: np.random.Generator, first: int, loads: int, shift: float = 0.0) -> Iterator[LoadValues]:
    scale = math.sqrt((_FREEDOM - 2) / _FREEDOM)
    places = _places()
    for number in range(first, first + loads):
        values: dict[WatchedPlace, Floats] = {p: scale * rng.standard_t(_FREEDOM, m) for p, m in places.items()}
        values[_CHANGED][0] += shift
        yield LoadValues(number, values)


def _quiet(loads: int, seed: int) -> None:
    rng, bank, raised = np.random.default_rng(seed), WatchBank(), 0
    spent = []
    for load in _loads(rng, 1, loads):
        began = time.perf_counter()
        raised += len(bank.add(load)[0])
        spent.append(time.perf_counter() - began)
    part = max(1, loads // 10)
    early, late = np.median(spent[:part]) * 1e3, np.median(spent[-part:]) * 1e3
    print(
        f"{loads} quiet loads, {bank.streams} streams: {raised} false alarms, {raised / loads * 1000:.3f} per 1,000",
        end="",
    )
    print(f" (goal at most 1); a load costs {early:.2f} ms at first, {late:.2f} ms at last (goal 300 ms, flat)")


def _changes(size: float, changes: int, seed: int) -> None:
    """A change of `size` standard deviations in one component after 1,000 quiet loads, until it amounts to d = 8."""
    most = math.ceil((_TOTAL / size) ** 2)
    delays, peers, banks, near, named = [], [], [], 0, 0
    for change in range(changes):
        rng = np.random.default_rng([seed, int(size * 100), change])
        bank = _bank_before(rng)
        loads = list(_loads(rng, _LEARNT + 1, most, size))
        delay = next((i for i, load in enumerate(loads, 1) if any(_is_right(a.begin) for a in bank.add(load)[0])), None)
        for load in loads[delay:] if delay is not None else []:
            bank.add(load)
        delays.append(float("inf") if delay is None else delay)
        peers.append(_cusum(loads, size, DEFAULT_RUN_LENGTH))
        banks.append(_cusum(loads, size, DEFAULT_RUN_LENGTH * 2 * bank.streams))
        for alert in (a for a in bank.open if _is_right(a.begin)):
            bank.refresh(alert)
            near += abs(alert.begin - _LEARNT - 1) <= 2
            named += alert.place == _CHANGED
            break
    watch, peer, many = (float(np.median(found)) for found in (delays, peers, banks))
    spread = np.quantile(delays, [0.1, 0.9], method="nearest")
    print(
        f"change of {size:g} σ a load, {changes} times, d = 8 after {most} loads: delay {watch:g} loads (80 %:", end=""
    )
    print(
        f" {spread[0]:g} to {spread[1]:g}), CUSUM {peer:g}, ratio {watch / peer:.2f} (goal 1.3), of all {many:g};",
        end="",
    )
    print(f" beginning within 2 loads {near / changes:.2f}, right name {named / changes:.2f} (goals .9)")


def _bank_before(rng: np.random.Generator) -> WatchBank:
    bank = WatchBank()
    for load in _loads(rng, 1, _LEARNT):
        bank.add(load)
    return bank


def _is_right(begin: int) -> bool:
    return begin > _LEARNT - 50


def _cusum(loads: list[LoadValues], size: float, run_length: float) -> float:
    """Loads until the CUSUM of the changed component alarms."""
    limit, total = _siegmund(size, run_length), 0.0
    for i, load in enumerate(loads, 1):
        total = max(0.0, total + float(load.values[_CHANGED][0]) - size / 2)
        if total >= limit:
            return i
    return float("inf")


def _siegmund(size: float, run_length: float) -> float:
    """Threshold h at which a CUSUM with k = size/2 runs so many loads: ARL = (e^2kb − 2kb − 1) / 2k², b = h + 1.166."""
    low, high = 0.0, 50.0
    for _ in range(60):
        middle = (low + high) / 2
        kb = size * (middle + _OVERSHOOT)
        low, high = (middle, high) if (math.exp(kb) - kb - 1) / (size**2 / 2) < run_length else (low, middle)
    return high


if __name__ == "__main__":
    main()
