"""A raw table → a recording in the recipe's unit, with what was understood and how."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from station.domain.recognition import (
    axis_units,
    bad_rows,
    clock,
    columns,
    header_unit,
    held,
    quantities,
    temperatures,
    time_column,
    unit_change,
    visits,
)
from station.domain.recognition.clock import SampleClock
from station.domain.recognition.columns import Roles
from station.domain.recognition.quantities import QUANTITIES, Quantity, UnitScale
from station.domain.recognition.raw_table import ImportOptions, RawTable
from station.errors import SamplesError, UsageError
from station.messages import Message

#: Fewer rests than these, among readings all round, are chance.
LEAST_RESTS = 5
#: An axis of fewer equal readings may be one that nothing turned.
LEAST_DEAD = 20


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Readings (n, 3) in the recipe's unit at time_s (n), temperature_degC (n) or None. edges (k, 2): visits that the
    recording itself declares, or None; names: of their labels, or None; declared: how (labels, blocks, shown-blocks).
    names_no_axes: the columns have names, and none of them is of an axis.
    """

    source: str
    time_s: Floats
    reading: Floats
    temperature_degC: Floats | None
    edges: NDArray[np.int64] | None
    names: tuple[str, ...] | None
    declared: str | None
    axes: tuple[str, str, str]
    axes_inferred: bool
    clock: SampleClock
    scale: UnitScale
    unit: str
    remarks: tuple[Message, ...]
    degrees_inferred: bool = False
    names_no_axes: bool = False

    def __len__(self) -> int:
        return len(self.time_s)


def understand(
    table: RawTable, options: ImportOptions, unit: str, assumed_rate_hz: float, rates: Floats | None = None
) -> Recording:
    """A table's readings in `unit`; assumed_rate_hz: where neither stamps nor a person tell the rate; rates (p, 3):
    turn rates of the recipe's positions, deg/s, by which readings without a unit are scaled.

    Errors: UsageError, SamplesError.
    """
    quantity = QUANTITIES[unit]
    roles = columns.assign(table, options, quantity)
    keep, remarks = bad_rows.usable(table, roles.axes, roles.time, quantity)
    keep, twice = _once(table, roles, keep)
    remarks = (*remarks, *twice)
    raw = np.stack([table.numbers(i)[keep] for i in roles.axes], axis=1)
    ticks = _clock(table, roles, options, keep, assumed_rate_hz)
    raw, usable = raw[ticks.order], keep[ticks.order]
    blocks = None if options.blocks is None else visits.blocks(table.source, raw, options.blocks)
    fresh = held.fresh_rows(raw)
    if fresh is not None:
        blocks = None if blocks is None else np.searchsorted(fresh, blocks)
        remarks = (*remarks, _held(table, ticks, len(raw) / len(fresh)))
        raw, usable, ticks = raw[fresh], usable[fresh], ticks.only(fresh)
    raw, corrupt, said = bad_rows.corrupt_readings(table.source, raw)
    remarks = (*remarks, *said)
    _check_alive(table, roles, raw)
    of_axes = axis_units.stated(table, roles.axes, options.unit, quantity)
    if of_axes is not None:
        raw = raw * axis_units.factors(of_axes, quantity)
        remarks = (*remarks, _brought_together(table, roles, of_axes, unit))
    unit_change.check(table.source, raw, quantity)
    edges, names, declared = _declared(table, roles, blocks, usable, raw)
    shown = declared == "shown-blocks" and ticks.unit != "none"
    found = declared == "labels" and options.labels is None and unit == "g"
    phases = found and edges is not None and not visits.mostly_rest(raw, edges)
    if shown or phases:
        edges, names, declared = None, None, None
    if phases and roles.labels is not None:
        remarks = (*remarks, Message("labels-of-motion", file=table.source, column=table.columns[roles.labels].name))
    means = _rest_means(ticks.time_s, raw, edges, quantity)
    if of_axes is None:
        axis_units.check(table, roles.axes, means, quantity)
        stated = _scale(table, roles, options, quantity, means, raw, rates)
        scale, doubts = header_unit.believed(table.source, means, stated, quantity, whole=_are_whole(raw))
        remarks = (*remarks, *doubts)
    else:
        scale = UnitScale(unit, 1.0, inferred=False)
    temperature, lost = _temperature(table, roles, usable)
    whole = Recording(
        source=table.source,
        time_s=ticks.time_s,
        reading=(raw - scale.zero) * scale.factor,
        temperature_degC=temperature,
        edges=edges,
        names=names,
        declared=declared,
        axes=tuple(table.columns[i].name for i in roles.axes),  # type: ignore[arg-type]
        axes_inferred=roles.inferred,
        clock=ticks,
        scale=scale,
        unit=unit,
        degrees_inferred=roles.temperature is not None
        and not temperatures.says_degrees(table.columns[roles.temperature]),
        names_no_axes=table.named and roles.rank == columns.BY_CONTENT and not columns.are_axes(table, roles.axes),
        remarks=(
            *table.remarks,
            *remarks,
            *lost,
            *_unread(table, roles, ticks),
            *_paced(table, ticks, options),
            *_sorted(table, ticks),
            *_others(table, roles),
        ),
    )
    return _without(whole, corrupt)


def _brought_together(table: RawTable, roles: Roles, units: axis_units.Units, unit: str) -> Message:
    """What is said of axes in different units."""
    each = tuple(f"{table.columns[i].name} [{own}]" for i, own in zip(roles.axes, units, strict=True))
    return Message("axes-of-several-units", file=table.source, axes=each, unit=unit)


def _once(table: RawTable, roles: Roles, keep: NDArray[np.intp]) -> tuple[NDArray[np.intp], tuple[Message, ...]]:
    """The rows without those written again, and what is said of these."""
    stamps = None if roles.time is None else table.columns[roles.time].values
    if stamps is None:
        return keep, ()
    first = held.rows_once(stamps[keep], np.stack([table.numbers(i)[keep] for i in roles.axes], axis=1))
    if first is None:
        return keep, ()
    return keep[first], (Message("rows-written-again", file=table.source, rows=len(keep) - len(first)),)


def _held(table: RawTable, ticks: SampleClock, times: float) -> Message:
    """What is said of readings that come several times each."""
    return Message("readings-held", file=table.source, times=times, rate_hz=ticks.rate_hz / times)


def _without(one: Recording, corrupt: NDArray[np.bool_]) -> Recording:
    """The recording without some of its readings (n), and its visits without those."""
    if not corrupt.any():
        return one
    rows = np.flatnonzero(~corrupt)
    edges, names = one.edges, one.names
    if edges is not None:
        edges = np.searchsorted(rows, edges)
        left = edges[:, 1] > edges[:, 0]
        edges, names = edges[left], None if names is None else tuple(np.array(names, object)[left])
    warm = None if one.temperature_degC is None else one.temperature_degC[rows]
    ticks = one.clock.without_few(rows)
    return replace(
        one,
        time_s=ticks.time_s,
        reading=one.reading[rows],
        temperature_degC=warm,
        edges=edges,
        names=names,
        clock=ticks,
    )


def _paced(table: RawTable, ticks: SampleClock, options: ImportOptions) -> Iterator[Message]:
    """What is said of stamps far off the pace of the others, and of a pace that is no sensor's in the header's unit."""
    if ticks.of_steps:
        yield Message("stamps-are-steps", file=table.source, rate_hz=ticks.rate_hz)
    if ticks.outliers:
        yield Message("import-stamp-outliers", file=table.source, count=ticks.outliers)
    likelier = None if options.time_unit is not None else clock.likelier_unit(ticks)
    if likelier is not None:
        rate_hz = ticks.rate_hz * clock.TIME_UNITS[ticks.unit] / clock.TIME_UNITS[likelier]
        yield Message(
            "time-header-doubtful",
            file=table.source,
            stated=ticks.unit,
            rate_hz=ticks.rate_hz,
            likelier=likelier,
            likely_hz=rate_hz,
        )


def _sorted(table: RawTable, ticks: SampleClock) -> tuple[Message, ...]:
    """What is said of rows that were in another order than that of time."""
    late = float(np.mean(np.diff(ticks.order) < 0)) if len(ticks.order) > 1 else 0.0
    return (Message("rows-sorted", file=table.source),) if late > clock.BACKWARDS else ()


def _others(table: RawTable, roles: Roles) -> tuple[Message, ...]:
    """What is said of axes that could have been taken as well."""
    if not roles.others:
        return ()
    names = tuple(", ".join(table.columns[i].name for i in axes) for axes in roles.others)
    return (Message("axes-of-others", file=table.source, axes=names),)


def _check_alive(table: RawTable, roles: Roles, raw: Floats) -> None:
    """Errors: SamplesError where an axis stands still while the others turn."""
    range_, size = np.ptp(raw, axis=0), float(np.median(np.linalg.norm(raw, axis=1)))
    dead = np.flatnonzero(range_ == 0)
    if len(dead) and len(raw) >= LEAST_DEAD and float(range_.max()) > columns.LEAST_TURN * size > 0:
        name = table.columns[roles.axes[int(dead[0])]].name
        raise SamplesError("axis-dead", file=table.source, column=name, value=float(raw[0, dead[0]]))


def _unread(table: RawTable, roles: Roles, ticks: SampleClock) -> tuple[Message, ...]:
    """What is said of stamps that nobody could read, where nothing else tells the rate."""
    column = time_column.unread_time(table) if roles.time is None and ticks.source == "assumed" else None
    if column is None or column.text is None:
        return ()
    stamp = next((name for name in column.text.names if name.strip()), "")[:40]
    return (Message("stamps-unread", file=table.source, column=column.name, stamp=stamp, rate_hz=ticks.rate_hz),)


def _clock(
    table: RawTable, roles: Roles, options: ImportOptions, keep: NDArray[np.intp], assumed_rate_hz: float
) -> SampleClock:
    if roles.time is not None and not (options.rate_hz is not None and _tells_nothing(table.numbers(roles.time)[keep])):
        column = table.columns[roles.time]
        assert column.values is not None
        unit = None if options.time_unit == "none" else options.time_unit
        found = clock.stamped(table.source, column.values[keep], column.name, column.unit, unit, table.rate_hz)
        if options.rate_hz is not None:
            time_s = np.arange(len(keep)) / options.rate_hz
            found = replace(found, rate_hz=options.rate_hz, source="given", time_s=time_s)
        return found
    if options.time_unit not in (None, "none"):
        raise UsageError("no-time-column", file=table.source, unit=str(options.time_unit))
    counter = None if roles.counter is None else table.columns[roles.counter].values
    rate_hz = options.rate_hz or table.rate_hz
    if rate_hz is not None and not rate_hz > 0:
        raise UsageError("rate-not-positive", rate_hz=rate_hz)
    source = "given" if options.rate_hz else "data" if table.rate_hz else "assumed"
    return clock.counted(len(keep), None if counter is None else counter[keep], rate_hz or assumed_rate_hz, source)


def _tells_nothing(stamps: Floats) -> bool:
    """Whether stamps (n) are too few different ones to tell when a reading was taken."""
    return len(np.unique(stamps)) < clock.FEWEST_STAMPS


def _declared(
    table: RawTable, roles: Roles, blocks: NDArray[np.int64] | None, usable: NDArray[np.intp], raw: Floats
) -> tuple[NDArray[np.int64] | None, tuple[str, ...] | None, str | None]:
    if blocks is not None:
        return blocks, None, "blocks"
    if roles.labels is not None:
        edges, names = visits.labelled(table.source, table.columns[roles.labels], usable)
        return edges, names, "labels"
    length = visits.shown_blocks(raw)
    return (visits.blocks(table.source, raw, length), None, "shown-blocks") if length else (None, None, None)


def _rest_means(time_s: Floats, raw: Floats, edges: NDArray[np.int64] | None, quantity: Quantity) -> Floats:
    """Mean raw readings (k, 3) at rest, or of parts where nothing rests; of a compass that goes round its ellipsoid all
    readings, as a field shows at any time."""
    if edges is None:
        try:
            edges = rest_segments.find(time_s, raw)
        except SamplesError:
            edges = np.zeros((0, 2), np.int64)
    field = quantity.unit == "uT"
    if (len(edges) < LEAST_RESTS or field) and visits.is_pose_each(raw, any_offset=field):
        return raw
    if not len(edges):
        rows = min(50, len(raw))
        return np.asarray(raw[: len(raw) // rows * rows].reshape(-1, rows, 3).mean(axis=1))
    return np.array([np.median(raw[a:b], axis=0) for a, b in edges])


def _scale(
    table: RawTable,
    roles: Roles,
    options: ImportOptions,
    quantity: Quantity,
    means: Floats,
    raw: Floats,
    rates: Floats | None,
) -> UnitScale:
    if options.scale is not None or options.zero is not None:
        return UnitScale("raw", options.scale or 1.0, options.zero or 0.0, inferred=False)
    stated = columns.stated_unit(table, roles.axes, quantity) if table.named else None
    if options.unit is not None:
        stated = quantities.canonical(options.unit, quantity)
        if stated is None:
            known = ", ".join((*quantity.factors, "LSB"))
            raise UsageError("unit-of-readings-unknown", unit=options.unit, known=known)
    whole = _are_whole(raw)
    if stated is not None and stated != "LSB":
        return UnitScale(stated, quantity.factors[stated], inferred=False, of_header=options.unit is None)
    if rates is not None:
        return quantities.from_rates(means, rates, quantity, whole=whole or stated == "LSB")
    found = quantities.from_magnitude(means, quantity, whole=whole or stated == "LSB")
    return replace(found, inferred=stated is None)


def _are_whole(raw: Floats) -> bool:
    return bool(np.all(raw[:1000] % 1 == 0))


def _temperature(table: RawTable, roles: Roles, usable: NDArray[np.intp]) -> tuple[Floats | None, tuple[Message, ...]]:
    """Temperature (n) in °C; a thermometer that says something now and then is taken as a line between its readings."""
    if roles.temperature is None:
        return None, ()
    column = table.columns[roles.temperature]
    read = table.numbers(roles.temperature)[usable]
    values = temperatures.in_celsius(column, read)
    if values is None:
        return None, (Message("temperature-no-degrees", file=table.source, column=column.name),)
    known = np.flatnonzero(np.isfinite(values))
    others = tuple(table.columns[i].name for i in roles.thermometers)
    said = (Message("thermometers-of-others", file=table.source, column=column.name, others=others),) if others else ()
    if temperatures.are_kelvin_called_celsius(column, read):
        said = (*said, Message("kelvin-called-celsius", file=table.source, column=column.name))
    return np.interp(np.arange(len(values)), known, values[known]), said
