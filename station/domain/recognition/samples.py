"""Recordings → a samples table: their visits, found or declared, and the names of the positions."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.capture import rest_segments
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.evaluation.quality import FACE_DEG
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import no_rest, spins, visits
from station.domain.recognition.quantities import QUANTITIES, sphere
from station.domain.recognition.quiet_readings import MOST_POSES, portion, quietest
from station.domain.recognition.raw_table import RawTable
from station.domain.recognition.recording import Recording
from station.errors import SamplesError, UsageError, naming_file
from station.messages import Message

#: A recording that rests for less than this share of its time, in fewer orientations, is no tumble.
LEAST_REST, LEAST_ORIENTATIONS = 0.5, 3
#: Nor is one that rests for less than this share and comes back to one orientation every time.
LEAST_REST_IN_ONE = 0.9
#: A field that nothing but its size tells is turned through more than a few.
LEAST_OF_A_FIELD = 6
#: Or in few orientations with a magnitude that ranges over this share of itself: something pushed the unit.
PUSHED = 0.1
#: An offset and a size fit any four magnitudes: so many rests are more than twice that.
LEAST_FOR_OFFSET = 9
#: No sensor that is turned by a fixture or a hand reads more, deg/s.
FASTEST_DEG_S = 5000.0
#: Slower than this share of the fastest is rest.
AT_REST = 0.05
#: The Earth's own turning, deg/s, is all that a gyroscope feels at rest.
EARTH_DEG_S = 0.0045
#: Gravity shows in an accelerometer at rest as at least so much, g, whatever its offset.
LEAST_GRAVITY_G = 0.3
#: An acceleration of unknown scale that scatters by this share of its own size at rest, or from rest to rest, is not
#: gravity; nor is one of such a name.
LOUD = 0.1
#: Without stamps the rate may be so many times slower; believed where so many times more orientations rest then.
SLOWER, MANY_MORE = (2.0, 4.0), 1.4
#: Neighbours nearer than this, g, are no poses of a list but a turn that was read on its way.
IN_MOTION_G = 0.1
#: A pose that is held less steadily than the steadiest scatters by so many times as much.
LOUDER = 3.0
#: Acceleration that stays this near to one ellipsoid, of its size, is gravity in a hand that turns slowly.
SLOWLY = 0.02
#: Runs are counted in 32 bits.
LAST_RUN = 2**31 - 1


@dataclass(frozen=True, slots=True, eq=False)
class UnitRecording:
    """One pass of one unit."""

    serial: str
    run: int
    recording: Recording


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """edges (k, 2) of a recording's visits, their positions' names, and how they were found: rest, labels, blocks,
    shown-blocks or readings."""

    edges: NDArray[np.int64]
    names: tuple[str, ...]
    found_by: str
    remarks: tuple[Message, ...] = ()


def is_samples_table(table: RawTable) -> bool:
    """Whether a table has the columns of station.samples/1 already."""
    return {"unit", "run", "visit", "position", "time_s", "x", "y", "z"} <= {c.name for c in table.columns}


def by_unit_and_run(table: RawTable) -> list[tuple[str | None, int, RawTable]]:
    """The passes of a table that this station wrote: serial, run, rows; one pass of nobody where it is none such."""
    places = {c.name: i for i, c in enumerate(table.columns)}
    if not {"unit", "run", "time_s"} <= places.keys():
        return [(None, 0, table)]
    unit, run = table.columns[places["unit"]], table.columns[places["run"]]
    if run.values is None:
        return [(None, 0, table)]
    serials = unit.text.text() if unit.text is not None else np.asarray(unit.values, object)
    numbers = np.asarray(run.values, float)
    wrong = np.flatnonzero(~((numbers >= 0) & (numbers <= LAST_RUN)))
    if len(wrong):
        value = float(numbers[wrong[0]])
        raise SamplesError("samples-not-a-count", place=table.source, column="run", value=value, limit=LAST_RUN)
    runs = numbers.astype(int).tolist()
    passes: list[tuple[str | None, int, RawTable]] = []
    for key in dict.fromkeys(zip(serials.tolist(), runs, strict=True)):
        rows = np.flatnonzero((serials == key[0]) & (np.array(runs) == key[1]))
        passes.append((str(key[0]), key[1], _rows(table, rows)))
    return passes


def _rows(table: RawTable, rows: NDArray[np.intp]) -> RawTable:
    return replace(table, columns=tuple(c[rows] for c in table.columns if c.name not in ("unit", "run")))


def visits_of(recording: Recording, recipe: Recipe | None, *, one_rest: bool = False) -> Visits:
    """The visits of a recording; one_rest: a single one will do. Errors: SamplesError where there are none, or it is
    no tumble."""
    if recording.edges is not None and recording.declared is not None:
        if recording.names_no_axes and _orientations(recording, recording.edges) < LEAST_ORIENTATIONS:
            raise SamplesError("columns-of-no-sensor", file=recording.source, axes=recording.axes)
        names = recording.names or tuple(f"block-{i + 1:03d}" for i in range(len(recording.edges)))
        found = Visits(recording.edges, names, recording.declared)
    else:
        found = _undeclared(recording, one_rest=one_rest)
    return found if recipe is None or not recipe.pose_known else _named(recording, found, recipe)


def _undeclared(recording: Recording, *, one_rest: bool) -> Visits:
    """By rest or, where nothing rests but the readings are a pose each, a visit a reading."""
    try:
        edges = _rest(recording)
        if recording.unit == "deg/s":
            spins.check(recording, edges, one_rate=one_rest)
        elif not (one_rest and len(edges) == 1):
            _check_tumble(recording, edges)
        if _swept(recording, edges):
            return _a_reading_each(recording)
    except SamplesError as error:
        if _is_listed(recording):
            return _a_reading_each(recording)
        if recording.names_no_axes:
            raise SamplesError("columns-of-no-sensor", file=recording.source, axes=recording.axes) from None
        raise _refused_list(recording) or error from None
    return Visits(edges, tuple(f"still-{i + 1:02d}" for i in range(len(edges))), "rest")


def _is_listed(recording: Recording) -> bool:
    """Whether each reading is a pose, as without stamps it may be. A magnetometer's field shows at any time; gravity
    while the hand rests, or turns so slowly that what it adds itself is small."""
    reading, unstamped = recording.reading, recording.clock.unit == "none"
    if recording.unit == "deg/s":
        return False
    if unstamped and visits.is_row_a_pose(reading):
        return True
    slowly = recording.unit == "uT" or unstamped or visits.off_ellipsoid(reading) < SLOWLY
    return slowly and visits.is_pose_each(reading, any_offset=recording.unit == "uT")


def _refused_list(recording: Recording) -> SamplesError | None:
    """Why readings that no clock or no rest tells apart are no list of poses, either: of a compass, which never needs
    to rest, and of what has no stamps. None where rest is all that is wrong."""
    turned = recording.unit == "uT" or (recording.clock.unit == "none" and len(recording) <= MOST_POSES)
    asked = turned and recording.unit != "deg/s"
    reason = visits.why_no_poses(recording.reading, any_offset=recording.unit == "uT") if asked else None
    if reason is None or (recording.unit != "uT" and reason.id == "list-in-one-pose"):
        return None
    what = "field-list" if recording.unit == "uT" else "unstamped-list"
    return SamplesError(what, file=recording.source, axes=recording.axes, reason=reason)


def _swept(recording: Recording, edges: NDArray[np.int64]) -> bool:
    """Whether a unit was turned all round with a stop here and there: motion does not spoil a compass's readings, nor,
    where it is slow, those of an accelerometer that rested in too few poses."""
    rests = _share(recording, edges) >= LEAST_REST
    few = recording.unit == "uT" or _orientations(recording, edges) < visits.LEAST_POSES
    return not rests and few and _is_listed(recording)


def _a_reading_each(recording: Recording) -> Visits:
    """Each reading a visit or, of very many, the quietest of every so many."""
    reading, n = recording.reading, len(recording)
    step = np.linalg.norm(np.diff(reading, axis=0), axis=1)
    moving = recording.unit == "g" and float(np.median(step)) < IN_MOTION_G
    every = visits.blocks(recording.source, reading, 1)
    each = portion(n, float(np.ptp(recording.time_s)), moving)
    edges = every[quietest(reading, each)]
    note = Message("readings-thinned", file=recording.source, readings=n, each=each, visits=len(edges))
    remarks = [note] if each > 1 else []
    if moving:
        remarks.append(Message("readings-in-motion", file=recording.source))
    names = tuple(f"reading-{i + 1:03d}" for i in range(len(edges)))
    return Visits(edges, names, "readings", tuple(remarks))


def _rest(recording: Recording) -> NDArray[np.int64]:
    try:
        with naming_file(recording.source):
            edges = _edges(recording)
    except SamplesError:
        if recording.clock.source != "assumed":
            raise
        few, rate_hz = len(recording), recording.clock.rate_hz
        raise SamplesError("unstamped-too-short", file=recording.source, readings=few, rate_hz=rate_hz) from None
    if recording.unit == "deg/s":
        _check_turn_rate(recording, edges)
        return edges
    if recording.unit == "g" and len(edges):
        _check_gravity_shows(recording, edges)
    size = float(np.median(np.linalg.norm(recording.reading, axis=1)))
    rests = [visits.rests(recording.reading[a:b], size) for a, b in edges]
    return np.asarray(edges[np.array(rests, bool)])


def _edges(recording: Recording) -> NDArray[np.int64]:
    """Rests; where nothing tells the rate, those of a slower one, if it makes most of the recording rests in many more
    orientations: a second of the assumed rate is longer than such stops. Where they are few, but in several
    orientations, those that are louder, too, if they show more of them: some poses are held less steadily."""
    found = rest_segments.find(recording.time_s, recording.reading)
    if recording.unit == "deg/s":
        return found
    if _share(recording, found) < LEAST_REST and (poses := _orientations(recording, found)) >= LEAST_ORIENTATIONS:
        louder = rest_segments.find(recording.time_s, recording.reading, LOUDER)
        found = louder if _orientations(recording, louder) > poses else found
    if recording.clock.source != "assumed":
        return found
    for slower in SLOWER:
        more = rest_segments.find(recording.time_s * slower, recording.reading)
        rests = _share(recording, more) >= LEAST_REST
        if rests and _orientations(recording, more) >= MANY_MORE * _orientations(recording, found):
            found = more
    return found


def _share(recording: Recording, edges: NDArray[np.int64]) -> float:
    """Which part of a recording rests."""
    return float((edges[:, 1] - edges[:, 0]).sum() / len(recording))


def _orientations(recording: Recording, edges: NDArray[np.int64]) -> int:
    if not len(edges):
        return 0
    means = np.array([np.median(recording.reading[a:b], axis=0) for a, b in edges])
    return int(rest_segments.orientations(means).max()) + 1


def _check_tumble(recording: Recording, edges: NDArray[np.int64]) -> None:
    share = _share(recording, edges)
    if not len(edges):
        raise no_rest.error_of(recording)
    means = np.array([np.median(recording.reading[a:b], axis=0) for a, b in edges])
    size = float(np.median(np.linalg.norm(means, axis=1)))
    if recording.unit == "g" and size < LEAST_GRAVITY_G:
        raise SamplesError("no-gravity", file=recording.source, size=size)
    if len(edges) == 1 and share >= LEAST_REST:
        raise SamplesError("one-rest-only", file=recording.source, rest_s=share * float(recording.time_s[-1]))
    poses = int(rest_segments.orientations(means).max()) + 1
    pushed = recording.unit == "g" and poses < visits.LEAST_POSES and _lengths_apart(means) > PUSHED * size
    comes_back = poses == 1 and share < LEAST_REST_IN_ONE
    # Nothing but their size says that they are a field.
    by_size = recording.unit == "uT" and recording.scale.inferred and not _named_a_field(recording)
    if comes_back and share >= LEAST_REST:
        percent = 100 * share
        raise SamplesError("one-pose-only", file=recording.source, rest_percent=percent, rests=len(edges))
    if (
        comes_back
        or (by_size and poses < LEAST_OF_A_FIELD)
        or (share < LEAST_REST and (poses < LEAST_ORIENTATIONS or pushed))
    ):
        raise SamplesError("no-tumble", file=recording.source, rest_percent=100 * share, poses=poses)


def _lengths_apart(mean: Floats) -> float:
    """How far the magnitudes of means (k, 3) lie apart, about 0 or about the offset that fits them best: a sensor that
    nobody has calibrated reads as much more on one face as it reads less on the opposite one."""
    centre, _ = sphere(mean)
    about = (np.zeros(3), centre) if len(mean) >= LEAST_FOR_OFFSET else (np.zeros(3),)
    return min(float(np.ptp(np.linalg.norm(mean - c, axis=1))) for c in about)


def _named_a_field(recording: Recording) -> bool:
    """Whether the columns or the file are called so."""
    return any(re.search(QUANTITIES["uT"].word, word) for word in re.split(r"[^a-z磁]+", " ".join(
        (*recording.axes, recording.source)).lower()))  # fmt: skip


def _check_turn_rate(recording: Recording, edges: NDArray[np.int64]) -> None:
    """Errors: SamplesError where numbers of no stated unit are larger at rest than any turn rate: they are counts."""
    if not recording.scale.inferred or not len(edges):
        return
    size = max(float(np.abs(np.median(recording.reading[a:b], axis=0)).max()) for a, b in edges)
    if size > FASTEST_DEG_S:
        raise SamplesError("turn-rate-in-counts", file=recording.source, size=size)


def _check_gravity_shows(recording: Recording, edges: NDArray[np.int64]) -> None:
    """Errors: SamplesError where a scale that makes the magnitude right is all that speaks for gravity, and the name,
    the scatter at rest or the magnitude from rest to rest against it."""
    scale = recording.scale
    raw = recording.reading[:1000] / scale.factor + scale.zero
    if scale.exact or np.allclose(raw, np.round(raw), atol=1e-6, rtol=0):
        return
    if recording.names_no_axes:
        raise SamplesError("columns-of-no-sensor", file=recording.source, axes=recording.axes)
    length = np.linalg.norm([np.median(recording.reading[a:b], axis=0) for a, b in edges], axis=1)
    size = float(np.median(length))
    scatter = float(np.median([np.linalg.norm(recording.reading[a:b].std(axis=0)) for a, b in edges])) / size
    apart = float(np.median(np.abs(length - size))) / size
    if scatter > LOUD or apart > LOUD or no_rest.are_without_gravity(recording):
        percent = 100 * max(scatter, apart)
        raise SamplesError(
            "gravity-not-shown",
            file=recording.source,
            axes=recording.axes,
            size=size / abs(scale.factor),
            percent=percent,
        )


def _named(recording: Recording, found: Visits, recipe: Recipe) -> Visits:
    """Visits called by the recipe's positions: their labels where they are those, else the nearest by direction."""
    known = [p.name for p in recipe.positions]
    if set(found.names) <= set(known):
        return found
    means = np.array([recording.reading[a:b].mean(axis=0) for a, b in found.edges])
    names = _nearest(recipe, means)
    named = [i for i, name in enumerate(names) if name]
    if not named:
        raise SamplesError("no-visit-near-a-position", file=recording.source, recipe=recipe.name, degrees=FACE_DEG)
    lost = len(names) - len(named)
    note = (Message("visits-near-no-position", file=recording.source, visits=lost, recipe=recipe.name),) if lost else ()
    return Visits(found.edges[named], tuple(names[i] for i in named), found.found_by, note)


def _nearest(recipe: Recipe, mean: Floats) -> list[str]:
    """The nearest position of each mean reading (k, 3) by direction, of turn rates by speed, too; '' where none is
    within FACE_DEG. A compass may lie off its centre by more than the field."""
    true = np.array([recipe.true_vector(p) for p in recipe.positions])
    if recipe.feels_rotation:
        wide, turned = np.ptp(mean, axis=0).max(), np.ptp(true, axis=0).max()
        names = _nearest_rate(recipe, mean, true)
        # In a range that is set wrong the speeds are to each other as they should be.
        return names if any(names) or not wide > 0 else _nearest_rate(recipe, mean * turned / wide, true)
    mean = mean - sphere(mean)[0] if recipe.unit == "uT" else mean
    sizes = np.linalg.norm(mean, axis=1)[:, None] * np.linalg.norm(true, axis=1)
    cosines = (mean @ true.T) / np.maximum(sizes, 1e-300)
    best = cosines.argmax(axis=1)
    near = cosines.max(axis=1) > np.cos(np.deg2rad(FACE_DEG))
    return [recipe.positions[b].name if ok else "" for b, ok in zip(best, near, strict=True)]


def _nearest_rate(recipe: Recipe, mean: Floats, true: Floats) -> list[str]:
    """The position of the nearest rate; '' also at rest where the recipe rests in several positions, which no turn rate
    tells apart. What is read at rest is an offset of any direction."""
    speed = np.linalg.norm(true, axis=1)
    fastest = float(np.max(speed, initial=0.0))
    apart = np.linalg.norm(mean[:, None] - true, axis=2)
    best = apart.argmin(axis=1)
    near = apart.min(axis=1) < np.maximum(np.sin(np.deg2rad(FACE_DEG)) * speed, AT_REST * fastest)[best]
    if fastest < EARTH_DEG_S:  # Rest is all that the recipe knows: what is slow beside the other stretches.
        turns = np.linalg.norm(mean, axis=1)
        near = turns <= max(2 * float(turns.min()), AT_REST * float(turns.max()))
    resting = speed < AT_REST * fastest
    told = ~resting | (np.count_nonzero(resting) == 1)
    return [recipe.positions[b].name if ok and told[b] else "" for b, ok in zip(best, near, strict=True)]


def samples_table(passes: Sequence[tuple[UnitRecording, Visits]]) -> SampleTable:
    """One samples table of several passes; temperature where all of them know it. Errors: UsageError."""
    keys = [(p.serial, p.run) for p, _ in passes]
    if len(set(keys)) < len(keys):
        raise UsageError("pass-twice", unit=next(k[0] for k in keys if keys.count(k) > 1))
    units, positions = _codes([p.serial for p, _ in passes]), _codes([n for _, v in passes for n in v.names])
    parts = [_part(p, v, units, positions) for p, v in passes]
    warm = all(p.recording.temperature_degC is not None for p, _ in passes)
    return SampleTable(
        unit=Labels(tuple(units), np.concatenate([part.unit.code for part in parts])),
        run=np.concatenate([part.run for part in parts]),
        visit=np.concatenate([part.visit for part in parts]),
        position=Labels(tuple(positions), np.concatenate([part.position.code for part in parts])),
        time_s=np.concatenate([part.time_s for part in parts]),
        reading=np.concatenate([part.reading for part in parts]),
        values={k: np.concatenate([part.values[k] for part in parts]) for k in ("temperature_degC",) if warm},
    )


def _codes(names: Sequence[str]) -> dict[str, int]:
    return {name: i for i, name in enumerate(dict.fromkeys(names))}


def _part(one: UnitRecording, visits: Visits, units: dict[str, int], positions: dict[str, int]) -> SampleTable:
    rows = np.concatenate([np.arange(a, b) for a, b in visits.edges])
    visit = np.repeat(np.arange(len(visits.edges), dtype=np.int32), visits.edges[:, 1] - visits.edges[:, 0])
    code = np.array([positions[n] for n in visits.names], np.int32)
    temperature = one.recording.temperature_degC
    return SampleTable(
        unit=Labels(tuple(units), np.full(len(rows), units[one.serial], np.int32)),
        run=np.full(len(rows), one.run, np.int32),
        visit=visit,
        position=Labels(tuple(positions), code[visit]),
        time_s=one.recording.time_s[rows],
        reading=one.recording.reading[rows],
        values={} if temperature is None else {"temperature_degC": temperature[rows]},
    )
