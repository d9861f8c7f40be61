"""Kept stops, with their raw frames, become the samples table of one unit: the same for a run, a replay and a refit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.can.decode import Samples, decode_samples, decode_temperatures
from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.sequence_counter import counter_steps
from station.domain.core.types import Floats, Frames, Labels, SampleTable

Rows = NDArray[np.intp]
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class CapturedVisit:
    """One stop of one unit as the record keeps it. The dwell is [from_ns, to_ns); frames may reach beyond it."""

    run: int
    visit: int
    position: str
    seating: str
    arrived_ns: int
    from_ns: int
    to_ns: int
    frames: Frames


def dwell_frames(visit: CapturedVisit) -> Frames:
    """The frames of the dwell proper, in the order of arrival."""
    time_ns = visit.frames.time_ns
    return visit.frames[(time_ns >= visit.from_ns) & (time_ns < visit.to_ns)]


def sample_table(
    serial: str,
    node: int,
    visits: Sequence[CapturedVisit],
    layout: SensorLayout,
    labels: Mapping[str, str] | None = None,
    *,
    counter_bits: int = 32,
    gold_node: int | None = None,
    everything: bool = False,
) -> SampleTable:
    """All readings of one unit's dwells, in the order given (station.samples/1).

    labels: station, nest, lot, operator, the same in every row. everything: also repeats and readings that are no
    number, for exports; else only what may be calibrated with. gold_node: of a gold reference whose frames are
    among the visits', brought to the readings' own times. time_s counts from the first arrival of the run;
    `counter` counts modulo 2^counter_bits (the recipe's), whatever modulus the product's own counter has.
    """
    parts = [decode_samples(dwell_frames(v), layout, node) for v in visits]
    rows = [np.flatnonzero(p.crc_ok if everything else p.usable) for p in parts]
    each = np.array([len(r) for r in rows], np.int64)
    starts = run_starts_ns(visits)
    begun = np.array([starts[v.run] for v in visits], np.int64)
    time_ns = np.concatenate([p.time_ns[r] for p, r in zip(parts, rows, strict=True)] or [np.zeros(0, np.int64)])
    texts = {"seating": Labels.of([v.seating for v in visits])[np.repeat(np.arange(len(visits)), each)]}
    texts |= {k: Labels((text,), np.zeros(len(time_ns), np.int32)) for k, text in (labels or {}).items() if text}
    first = min(starts.values(), default=0)
    return SampleTable(
        unit=Labels((serial,), np.zeros(len(time_ns), np.int32)),
        run=np.repeat(np.array([v.run for v in visits], np.int32), each),
        visit=np.repeat(np.array([v.visit for v in visits], np.int32), each),
        position=Labels.of([v.position for v in visits])[np.repeat(np.arange(len(visits)), each)],
        time_s=(time_ns - np.repeat(begun, each)) / 1e9,
        reading=np.concatenate([p.xyz[r] for p, r in zip(parts, rows, strict=True)] or [np.zeros((0, 3))]),
        labels=texts,
        values={
            "started_s": np.repeat(begun - first, each) / 1e9,
            **_counter(visits, parts, rows, layout.counter_values, 1 << counter_bits),
            **_temperature(visits, time_ns, layout, node),
        },
        gold=None if gold_node is None else _gold(visits, parts, rows, layout, gold_node),
    )


def run_starts_ns(visits: Sequence[CapturedVisit]) -> dict[int, int]:
    """First arrival of each run, ns."""
    starts: dict[int, int] = {}
    for v in visits:
        starts[v.run] = min(starts.get(v.run, v.arrived_ns), v.arrived_ns)
    return starts


def _gold(
    visits: Sequence[CapturedVisit], parts: list[Samples], rows: list[Rows], layout: SensorLayout, node: int
) -> Floats:
    """The gold reference (n, 3) at the times of the readings; NaN where it said nothing during a dwell."""
    out = []
    for visit, part, row in zip(visits, parts, rows, strict=True):
        told = decode_samples(dwell_frames(visit), layout, node)
        time_ns, xyz = told.time_ns[told.usable], told.xyz[told.usable]
        at = (part.time_ns[row] - visit.from_ns) / 1e9
        if len(time_ns):
            since = (time_ns - visit.from_ns) / 1e9
            out.append(np.stack([np.interp(at, since, axis) for axis in xyz.T], axis=1))
        else:
            out.append(np.full((len(at), 3), np.nan))
    return np.concatenate(out or [np.zeros((0, 3))])


def _counter(
    visits: Sequence[CapturedVisit], parts: list[Samples], rows: list[Rows], values: int, modulus: int
) -> dict[str, Floats]:
    """The frame counter, counted on over each run: an end-to-end profile's counts to 14 only."""
    told = [
        (v.run, p.counter[r], p.time_ns[r])
        for v, p, r in zip(visits, parts, rows, strict=True)
        if p.counter is not None
    ]
    if not told:
        return {}
    out = []
    for run in dict.fromkeys(run for run, _, _ in told):
        stops = [(c, t) for r, c, t in told if r == run]
        out.append(_unwrap_counter([s for s in stops if len(s[0])], values) % modulus)
    return {"counter": np.concatenate(out).astype(np.float64)}


def _unwrap_counter(stops: list[tuple[NDArray[np.uint64], Times]], values: int) -> NDArray[np.int64]:
    """Counters and times of a run's stops, one after the other, as one count: the moves in between are some frames of
    the stops' own rate long, of which the counter knows the number modulo `values`."""
    within = [counter_steps(counter, time_ns, values) for counter, time_ns in stops]
    frames = sum(int(w.sum()) for w in within)
    elapsed_ns = sum(int(t[-1] - t[0]) for _, t in stops)
    numbers: list[NDArray[np.int64]] = []
    for (counter, time_ns), ahead in zip(stops, within, strict=True):
        first = int(counter[0])
        if numbers:
            before, last_ns = stops[len(numbers) - 1][0], stops[len(numbers) - 1][1][-1]
            gap = (first - int(before[-1])) % values
            if elapsed_ns > 0:
                expected = int(time_ns[0] - last_ns) * frames / elapsed_ns
                gap += values * max(round((expected - gap) / values), 0)
            first = int(numbers[-1][-1]) + gap
        numbers.append(first + np.concatenate([[0], np.cumsum(ahead)]))
    return np.concatenate(numbers) if numbers else np.zeros(0, np.int64)


def _temperature(visits: Sequence[CapturedVisit], at: Times, layout: SensorLayout, node: int) -> dict[str, Floats]:
    """The device's own thermometer at the times `at` (n): it speaks rarely, so whole stops are looked through."""
    told = [decode_temperatures(v.frames, layout, node) for v in visits]
    time_ns = np.concatenate([t for t, _ in told] or [np.zeros(0, np.int64)])
    if not len(time_ns):
        return {}
    degC = np.concatenate([d for _, d in told])
    order = np.argsort(time_ns, kind="stable")
    zero = time_ns[order[0]]
    return {"temperature_degC": np.interp((at - zero) / 1e9, (time_ns[order] - zero) / 1e9, degC[order])}
