"""Decoded visits become the samples table of one unit: the same for a run, a replay and a refit."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.can.sequence_counter import counter_steps
from station.domain.capture.visit import CapturedVisit, Visit
from station.domain.core.types import Floats, Labels, SampleTable

Rows = NDArray[np.intp]
Times = NDArray[np.int64]


def sample_table(
    serial: str,
    visits: Sequence[Visit],
    counter_values: int,
    labels: Mapping[str, str] | None = None,
    *,
    counter_bits: int = 32,
    everything: bool = False,
) -> SampleTable:
    """All readings of one unit's dwells, in the order given (station.samples/1).

    labels: station, nest, lot, operator, the same in every row. everything: also repeats and readings that are no
    number, for exports; else only what may be calibrated with. A gold reference is brought to the readings' own
    times. time_s counts from the first arrival of the run; `counter` counts modulo 2^counter_bits (the recipe's),
    whatever modulus, counter_values, the product's own counter has.
    """
    rows = [np.flatnonzero(v.samples.crc_ok if everything else v.samples.usable) for v in visits]
    each = np.array([len(r) for r in rows], np.int64)
    starts = run_starts_ns(visits)
    begun = np.array([starts[v.run] for v in visits], np.int64)
    chosen = list(zip(visits, rows, strict=True))
    time_ns = np.concatenate([v.samples.time_ns[r] for v, r in chosen] or [np.zeros(0, np.int64)])
    texts = {"seating": Labels.of([v.seating for v in visits])[np.repeat(np.arange(len(visits)), each)]}
    texts |= {k: Labels((text,), np.zeros(len(time_ns), np.int32)) for k, text in (labels or {}).items() if text}
    first = min(starts.values(), default=0)
    return SampleTable(
        unit=Labels((serial,), np.zeros(len(time_ns), np.int32)),
        run=np.repeat(np.array([v.run for v in visits], np.int32), each),
        visit=np.repeat(np.array([v.visit for v in visits], np.int32), each),
        position=Labels.of([v.position for v in visits])[np.repeat(np.arange(len(visits)), each)],
        time_s=(time_ns - np.repeat(begun, each)) / 1e9,
        reading=np.concatenate([v.samples.xyz[r] for v, r in chosen] or [np.zeros((0, 3))]),
        labels=texts,
        values={
            "started_s": np.repeat(begun - first, each) / 1e9,
            **_counter(visits, rows, counter_values, 1 << counter_bits),
            **_temperature(visits, time_ns),
        },
        gold=_gold(visits, rows),
    )


def run_starts_ns(visits: Sequence[CapturedVisit | Visit]) -> dict[int, int]:
    """First arrival of each run, ns."""
    starts: dict[int, int] = {}
    for v in visits:
        starts[v.run] = min(starts.get(v.run, v.arrived_ns), v.arrived_ns)
    return starts


def _gold(visits: Sequence[Visit], rows: list[Rows]) -> Floats | None:
    """The gold reference (n, 3) at the times of the readings; NaN where it said nothing during a dwell."""
    out = []
    for visit, row in zip(visits, rows, strict=True):
        if visit.gold is None:
            return None
        time_ns, xyz = visit.gold.time_ns[visit.gold.usable], visit.gold.readings
        at = (visit.samples.time_ns[row] - visit.from_ns) / 1e9
        if len(time_ns):
            since = (time_ns - visit.from_ns) / 1e9
            out.append(np.stack([np.interp(at, since, axis) for axis in xyz.T], axis=1))
        else:
            out.append(np.full((len(at), 3), np.nan))
    return np.concatenate(out) if out else None


def _counter(visits: Sequence[Visit], rows: list[Rows], values: int, modulus: int) -> dict[str, Floats]:
    """The frame counter, counted on over each run: an end-to-end profile's counts to 14 only."""
    counted = [
        (v.run, v.samples.counter[r], v.samples.time_ns[r])
        for v, r in zip(visits, rows, strict=True)
        if v.samples.counter is not None
    ]
    if not counted:
        return {}
    out = []
    for run in dict.fromkeys(run for run, _, _ in counted):
        own = [(c, t) for r, c, t in counted if r == run and len(c)]
        out.append(_unwrap_counter(own, values) % modulus)
    return {"counter": np.concatenate(out).astype(np.float64)}


def _unwrap_counter(visits: list[tuple[NDArray[np.uint64], Times]], values: int) -> NDArray[np.int64]:
    """Counters and times of a run's visits, one after the other, as one count: the moves in between are some frames of
    the visits' own rate long, of which the counter knows the number modulo `values`."""
    within = [counter_steps(counter, time_ns, values) for counter, time_ns in visits]
    frames = sum(int(w.sum()) for w in within)
    elapsed_ns = sum(int(t[-1] - t[0]) for _, t in visits)
    numbers: list[NDArray[np.int64]] = []
    for (counter, time_ns), ahead in zip(visits, within, strict=True):
        first = int(counter[0])
        if numbers:
            before, last_ns = visits[len(numbers) - 1][0], visits[len(numbers) - 1][1][-1]
            gap = (first - int(before[-1])) % values
            if elapsed_ns > 0:
                expected = int(time_ns[0] - last_ns) * frames / elapsed_ns
                gap += values * max(round((expected - gap) / values), 0)
            first = int(numbers[-1][-1]) + gap
        numbers.append(first + np.concatenate([[0], np.cumsum(ahead)]))
    return np.concatenate(numbers) if numbers else np.zeros(0, np.int64)


def _temperature(visits: Sequence[Visit], at: Times) -> dict[str, Floats]:
    """The device's own thermometer at the times `at` (n): it speaks rarely, so whole visits are searched."""
    time_ns = np.concatenate([v.samples.temperature_time_ns for v in visits] or [np.zeros(0, np.int64)])
    if not len(time_ns):
        return {}
    degC = np.concatenate([v.samples.temperature_degC for v in visits])
    order = np.argsort(time_ns, kind="stable")
    zero = time_ns[order[0]]
    return {"temperature_degC": np.interp((at - zero) / 1e9, (time_ns[order] - zero) / 1e9, degC[order])}
