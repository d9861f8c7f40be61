"""Which columns are x, y, z, time, temperature and labels: by their names first, by their content where names do not
tell."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from station.domain.core.types import Array, Floats
from station.domain.recognition import axis_names, quaternions, temperatures, time_column, visits
from station.domain.recognition.quantities import (
    QUANTITIES,
    Quantity,
    canonical,
    from_magnitude,
    is_converter_middle,
    sphere,
)
from station.domain.recognition.raw_table import ImportOptions, RawColumn, RawTable
from station.errors import SamplesError, UsageError

_LABEL = re.compile(r"label|part|pos|pose|face|visit|segment|block|section|orient|state|name|标签|位置", re.IGNORECASE)
_DERIVED = re.compile(r"linear|user|free|gravity|filt|corr|cal(?!l)|euler|quat|angle|delta|jerk|std|var", re.IGNORECASE)
#: Triples that are computed and no readings, whatever their size.
_COMPUTED = re.compile(r"^q$|quat|^pos|position|veloc|^vel|euler|attitude|orientation|angle", re.IGNORECASE)
#: Columns of a table with names that are no axes, whatever their numbers.
_OTHER = re.compile(
    r"latitude|longitude|altitude|(^|[^a-z])(lat|lon|long|lng|alt|phi|theta|lux)($|[^a-z])|speed|bearing|heading|course"
    r"|direction|distance|accuracy|satellit|hdop|press|humid|baro|volt|batter|illumin|rssi|roll|pitch|yaw|angle"
    r"|(^|[^a-z])(rpm|gears?|fuel|oil|boost|air|map|maf)($|[^a-z])|torque|throttle|pedal|brake|steering|engine|coolant",
    re.IGNORECASE,
)
#: Ranks of names: from NAMELESS on they tell no quantity, from FOREIGN on another; without names content decides.
FOREIGN, BY_CONTENT, NAMELESS, BY_UNIT = 30, 25, 10, 2
#: Most labels that are visits and not identifiers, and how many readings each must last.
MOST_LABELS, LEAST_LASTING = 2000, 8
#: Rows of a list that has a name for each.
LEAST_NAMED, MOST_NAMED = 3, 500
#: What lies still and is gravity has its size within this share.
NEAR_GRAVITY = 0.05
#: A column of one number in this share of the rows tells nothing of a pose.
NEARLY_ALWAYS = 0.95
#: A sensor that is turned shows means that scatter by this share of their magnitude.
LEAST_TURN = 0.2
#: A field that ranges over less than this share of itself is a map's and goes round no ellipsoid, near one as it lies.
LEAST_RANGE = 0.01


#: Places of the columns that are x, y, z.
Axes = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Roles:
    """Places of the columns: axes (3), time, counter, temperature, labels or None; inferred: axes by content; rank: how
    well their names fit, 0 best; others: axes whose names fit as well; thermometers: columns that show temperatures,
    too."""

    axes: Axes
    time: int | None
    counter: int | None
    temperature: int | None
    labels: int | None
    inferred: bool
    rank: int
    others: tuple[Axes, ...] = ()
    thermometers: tuple[int, ...] = ()


def assign(table: RawTable, options: ImportOptions, quantity: Quantity) -> Roles:
    """Errors: UsageError, SamplesError where a column is named that is not there, or no three columns can be axes."""
    given = [place_of(table, name) for name in options.columns or ()]
    if options.columns is not None and len(given) not in (3, 4):
        raise UsageError("columns-not-three-or-four", columns=",".join(options.columns), count=len(given))
    label = place_of(table, options.labels) if options.labels is not None else None
    temperature = place_of(table, options.temperature) if options.temperature is not None else None
    if len(given) == 4:
        time: int | None = given[0]
    else:
        time = time_column.find(table, assigned={*given, label, temperature})
    counter = None
    if time is not None and options.time_unit == "none":
        time, counter = None, time
    elif time is None or (len(given) != 4 and time_column.is_counter(table.columns[time], table.named)):
        counter = time if time is not None else time_column.counter(table, given)
        time = None
    warm = [] if temperature is not None else temperatures.thermometers(table, {*given, time, counter, label})
    if warm:
        temperature, *warm = warm
        warm = (
            [i for i in warm if temperatures.shows_temperature(table, i)]
            if temperatures.shows_temperature(table, temperature)
            else []
        )
    if label is None and options.blocks is None and options.find_labels:
        label = _labels(table, {*given, time, counter, temperature})
    others: tuple[Axes, ...] = ()
    if given:
        axes, inferred = (given[-3], given[-2], given[-1]), False
        rank = _rank_of(table, axes, quantity)
    else:
        axes, inferred, rank, others = _axes(table, quantity, {time, counter, temperature, label})
    for place in (*axes, time, temperature):
        if place is not None and table.columns[place].values is None:
            raise SamplesError("column-is-text", file=table.source, column=table.columns[place].name)
    return Roles(axes, time, counter, temperature, label, inferred, rank, others, tuple(warm))


def place_of(table: RawTable, name: str) -> int:
    """The column of that name, or number from 0. Errors: SamplesError with the nearest names."""
    names = [c.name for c in table.columns]
    if table.named and name in names:
        return names.index(name)
    folded = [n.casefold() for n in names]
    if table.named and folded.count(name.strip().casefold()) == 1:
        return folded.index(name.strip().casefold())
    if name.strip().isdigit() and int(name) < len(names):
        return int(name)
    if not table.named:
        raise SamplesError("column-number-unknown", file=table.source, column=name, last=len(names) - 1)
    near = get_close_matches(name, names, 1, 0.0)
    listed = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    raise SamplesError("column-name-unknown", file=table.source, column=name, nearest=near[0], known=listed)


def _axes(table: RawTable, quantity: Quantity, assigned: set[int | None]) -> tuple[Axes, bool, int, tuple[Axes, ...]]:
    """Three columns, whether their content chose them, the rank of their names, and others of that rank."""
    triples = _triples(table, assigned) if table.named else []
    ranked = sorted((_rank(stem, table.columns[axes[0]].unit, quantity), axes) for stem, axes in triples)
    if ranked and (rank := ranked[0][0]) < FOREIGN:
        best = [axes for other, axes in ranked if other == rank]
        if len(best) == 1:
            return best[0], False, rank, ()
        chosen = _by_content(table, best, quantity)
        others = tuple(b for b in best if not set(b) & set(chosen) and _varies(table, b))
        return chosen, True, rank, others
    if ranked:
        raise SamplesError(
            "no-axes-of-quantity", file=table.source, unit=quantity.unit, found=_names(table, ranked[0][1])
        )
    free = _filled(table, [i for i in table.numeric() if i not in assigned and not _is_other(table, i)])
    free = quaternions.without_them(table, free)
    if len(free) < 3:
        raise SamplesError("no-three-axes", file=table.source, columns=", ".join(c.name for c in table.columns[:12]))
    runs = [(free[i], free[i + 1], free[i + 2]) for i in range(len(free) - 2)]
    if len(free) > 3 and len(free) % 3 == 0:
        runs = runs[::3]
    # Axes stand beside each other; a word between columns begins something else.
    runs = [run for run in runs if run[2] - run[0] == 2] or runs
    return (runs[0] if len(runs) == 1 else _by_content(table, runs, quantity)), True, BY_CONTENT, ()


def _filled(table: RawTable, free: list[int]) -> list[int]:
    """Columns without those that hold one number nearly always, as sensors that are not there and marks of errors do,
    where whole triples are left."""
    numbers = {i: table.numbers(i) for i in free}
    filled = [i for i in free if np.mean(numbers[i] == np.median(numbers[i])) < NEARLY_ALWAYS]
    return filled if len(filled) >= 3 and len(filled) % 3 == 0 else free


def _is_other(table: RawTable, place: int) -> bool:
    return table.named and _OTHER.search(table.columns[place].name) is not None


def _names(table: RawTable, places: Axes) -> str:
    return ", ".join(table.columns[i].name for i in places)


def _varies(table: RawTable, axes: Axes) -> bool:
    """Whether a sensor can have read three columns: not all are one number, as a flag is."""
    return any(np.ptp(np.nan_to_num(table.numbers(i))) > 0 for i in axes)


def _rank(stem: str, unit: str, quantity: Quantity) -> int:
    """How well a common part of three names, and their unit, fit a quantity: 0 best; FOREIGN and more is another
    quantity's."""
    words = stem.strip(" _.-[]()").lower()
    *head, tail = [w for w in re.split(r"[\s_.()\[\]-]+", words) if w] or [""]
    derived = 5 if _DERIVED.search(words) else 0
    behind = _quantities_of(tail) if head or stem.startswith(" ") else ()
    told = _quantities_of(unit) or behind
    named = ("_".join(head), words if head else "") if behind else (words,)
    if any(re.search(quantity.word, name) for name in named):
        return derived
    if any(re.search(q.word, name) for q in QUANTITIES.values() for name in named):
        return 40
    if _COMPUTED.search(words) or (told and quantity.unit not in told):
        return FOREIGN
    return (BY_UNIT if told and quantity.unit == told[0] else NAMELESS) + derived


def _quantities_of(unit: str) -> tuple[str, ...]:
    """The quantities that a unit may be of, the likeliest first; none of what is no unit."""
    known = ((q.unit, canonical(unit, q)) for q in QUANTITIES.values()) if unit else ()
    return tuple(name for name, found in known if found not in (None, "LSB"))


def _rank_of(table: RawTable, axes: Axes, quantity: Quantity) -> int:
    """How well the names of given axes fit; NAMELESS where they have nothing in common."""
    stems = [stem for stem, _ in _named_axes(table, axes)] if table.named else []
    return min((_rank(stem, table.columns[axes[0]].unit, quantity) for stem in stems), default=NAMELESS)


def _triples(table: RawTable, assigned: set[int | None]) -> list[tuple[str, Axes]]:
    """Columns whose names differ by x, y, z alone, or by three numbers: what is common to them, and their places."""
    free = (place for place in table.numeric() if place not in assigned and table.numbers(place).any())
    return _named_axes(table, free)


def are_axes(table: RawTable, places: Axes) -> bool:
    """Whether the names of three columns say that they are axes, whatever is in them."""
    return bool(_named_axes(table, places))


def _named_axes(table: RawTable, places: Iterable[int]) -> list[tuple[str, Axes]]:
    return list(axis_names.triples((place, table.columns[place].name) for place in places))


def _by_content(table: RawTable, candidates: list[Axes], quantity: Quantity) -> Axes:
    """Of several triples the one that turns, in a magnitude of a known unit, the steadiest at rest; or, for a turn
    rate, the one whose magnitude is the least steady."""
    readings = [np.stack([table.numbers(i) for i in c], axis=1) for c in candidates]
    if quantity.sizes is None:
        return candidates[int(np.argmax([_means_and_spread(r)[1] for r in readings]))]
    return candidates[min(range(len(candidates)), key=lambda i: _unlikely(readings[i], quantity))]


def _unlikely(reading: Floats, quantity: Quantity) -> tuple[int, float]:
    """Of readings (n, 3): 0 where they turn in a magnitude of a unit, 1 where gravity lies still, 2 where they turn in
    counts, which any number is near, 3 in another sensor's, 4 where nothing turns, 5 where a field would go round an
    ellipsoid, and they do not; relative spread of the magnitude."""
    means, spread = _means_and_spread(reading)
    off = visits.off_ellipsoid(np.nan_to_num(reading)) if quantity.unit == "uT" and np.isfinite(spread) else np.inf
    # Iron moves the centre of a compass, further than the field reaches.
    spread = min(spread, off)
    size = float(np.median(np.linalg.norm(means, axis=1)))
    # From rest to rest: a turn rate at rest is the same again, however it was turned between.
    scatter = np.linalg.norm(_stretches(reading).std(axis=1), axis=1)
    quiet = scatter <= np.median(scatter)
    turn = float(np.linalg.norm(means[quiet].std(axis=0)))
    round_it = off < visits.NEAR_ELLIPSOID and float(np.ptp(means, axis=0).max()) > LEAST_RANGE * size
    turns = turn > max(LEAST_TURN * size, float(np.median(scatter))) or round_it
    whole = bool(np.all(np.nan_to_num(reading[:1000]) % 1 == 0))
    if not turns or not np.isfinite(spread):
        still = quantity.unit == "g" and not whole and _is_gravity(size, quantity)
        return (1 if still else 4), spread
    known = not whole and from_magnitude(means, quantity, whole=False).unit != "LSB"
    # Turned in part, as an aircraft is, a compass shows its field by a magnitude that stays.
    if quantity.unit == "uT" and off >= visits.NEAR_ELLIPSOID and not (known and spread < visits.NEAR_ELLIPSOID):
        return 5, spread
    # Counts of a power of two a g are an accelerometer's.
    gravity = whole and quantity.unit == "uT" and from_magnitude(means, QUANTITIES["g"], whole=True).exact
    return (0 if known else 2) + int(gravity), spread


def _is_gravity(size: float, quantity: Quantity) -> bool:
    """Whether a magnitude is that of gravity in g or m/s²."""
    return any(abs(size * quantity.factors[unit] - 1) < NEAR_GRAVITY for unit in ("g", "m/s²"))


def _stretches(reading: Floats) -> Floats:
    """Readings (n, 3) in short stretches (k, rows, 3)."""
    rows = max(len(reading) // 200, 1)
    return np.asarray(np.nan_to_num(reading[: len(reading) // rows * rows]).reshape(-1, rows, 3))


def _means_and_spread(reading: Floats) -> tuple[Floats, float]:
    """Means (k, 3) over short stretches of readings (n, 3), and the relative spread of their magnitudes; endless where
    nothing varies."""
    means = _stretches(reading).mean(axis=1)
    centre, radius = sphere(means)
    if is_converter_middle(centre, radius):
        means = means - centre
    size = np.linalg.norm(means, axis=1)
    middle = float(np.median(size))
    alive = bool((np.ptp(np.nan_to_num(reading), axis=0) > 0).all())
    return means, float(1.4826 * np.median(np.abs(size - middle)) / middle) if middle > 0 and alive else np.inf


def _labels(table: RawTable, assigned: set[int | None]) -> int | None:
    """A column of text or whole numbers whose name says that it marks parts, and which lasts for some readings each."""
    for place, column in enumerate(table.columns):
        if place in assigned or not table.named or not _LABEL.search(column.name):
            continue
        codes = column.text.code if column.text is not None else column.values
        if codes is None or not (_marks_parts(np.asarray(codes)) or _names_each(table, column)):
            continue
        return place
    return None


def _names_each(table: RawTable, column: RawColumn) -> bool:
    """Whether a short table without a clock has a name for each row: means of poses."""
    rows = len(table)
    clocked = any(time_column.NAMES.search(c.name) for c in table.columns)
    if column.text is None or clocked or not LEAST_NAMED <= rows <= MOST_NAMED:
        return False
    return bool(np.all(column.text.code[1:] != column.text.code[:-1]))


def _marks_parts(codes: Array) -> bool:
    if codes.dtype.kind == "f" and not np.all(codes[np.isfinite(codes)] % 1 == 0):
        return False
    changes = np.count_nonzero(codes[1:] != codes[:-1])
    return bool(0 < changes < min(MOST_LABELS, len(codes) / LEAST_LASTING))


def stated_unit(table: RawTable, axes: Axes, quantity: Quantity) -> str | None:
    """The unit that the headers of the axes state; None where they state none, or no unit of this quantity."""
    columns = [table.columns[i] for i in axes]
    units = {canonical(c.unit, quantity) for c in columns if c.unit}
    if units and (unit := units.pop()):
        return unit
    tails = {canonical(tail, quantity) for c in columns for tail in _tails(c.name)} - {None}
    return tails.pop() if len(tails) == 1 else None


def _tails(name: str) -> list[str]:
    """What a name may end in that is a unit: acc_x_mps2, accelerometer_m_s2[0]; no name is a unit alone."""
    stem = re.sub(r"[\[(_. ]+[0-9][\])]?$|[_.]?[xyz]$", "", name.lower().strip())
    parts = [p for p in re.split(r"[_. ]", stem) if p]
    return [*parts[1:][-1:], "_".join(parts[-2:])] if len(parts) > 1 else []
