"""Units that readings come in, and what the readings' own size tells of them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from station.domain.core.types import Floats

#: Standard gravity, m/s².
STANDARD_GRAVITY = 9.80665
#: Sensitivity spreads by this much between parts of one type.
SPREAD = 0.25
#: Points lie on a sphere if they reach so far in each direction and stand off it by so little, of its radius (rms).
LEAST_REACH, MOST_OFF = 0.15, 0.3
#: Counts of a converter lie this near to a power of two a g.
COUNTS_SPREAD = 0.12
#: Numbers that are no whole ones are means of counts, if they are as large as this.
LEAST_COUNTS = 100
#: A centre this many radii away is no offset of a sensor.
FAR_OFF = 2.0
#: A usual field of the Earth, for counts of a compass that nothing else scales, uT.
USUAL_FIELD_UT = 50.0
#: Whole numbers of this size are as well the counts of any usual compass, of 3 to 16 a uT.
LIKE_COUNTS = ("mgauss",)
#: Units that readings are told to be in by their size; the others are rare, and have to be named.
USUAL_UNITS = ("g", "m/s²", "mg", "uT", "nT", "mT", "T", "gauss", "mgauss")
#: Of turn rates; readings of a device beside the speeds of a recipe tell which.
USUAL_RATES = ("deg/s", "rad/s", "mdeg/s")
#: Counts for 1 deg/s at the least: of converters of 16 bits and 4,000 deg/s.
LEAST_A_DEG = 6.0


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a sensor measures. unit: of the recipe; factors: of every other unit to it; word: a pattern that column
    names of it match; sizes: least and greatest magnitude of a stimulus at rest in `unit`, None where rest shows none.
    """

    unit: str
    word: str
    factors: Mapping[str, float] = field(default_factory=dict)
    sizes: tuple[float, float] | None = None


QUANTITIES = {
    "g": Quantity(
        "g",
        r"acc|beschl|specific.?force|加速|^a$|^f$",
        {
            "g": 1.0,
            "m/s²": 1 / STANDARD_GRAVITY,
            "mg": 1e-3,
            "µg": 1e-6,
            "cm/s²": 0.01 / STANDARD_GRAVITY,
            "mm/s²": 1e-3 / STANDARD_GRAVITY,
            "ft/s²": 0.3048 / STANDARD_GRAVITY,
        },
        (1.0, 1.0),
    ),
    "deg/s": Quantity(
        "deg/s",
        r"gyr|omega|angular|turn.?rate|drehrate|角速|^w$|^g$|^r$",
        {"deg/s": 1.0, "rad/s": 180 / np.pi, "mdeg/s": 1e-3, "mrad/s": 0.18 / np.pi, "deg/h": 1 / 3600, "rpm": 6.0},
    ),
    "uT": Quantity(
        "uT",
        r"mag|compass|kompass|磁|^m$|^b$|^h$",
        {"uT": 1.0, "nT": 1e-3, "mT": 1e3, "T": 1e6, "gauss": 100.0, "mgauss": 0.1},
        (20.0, 70.0),
    ),
}

_SPELLINGS = {
    "g": "g", "gn": "g", "gee": "g", "m/s2": "m/s²", "ms2": "m/s²", "mps2": "m/s²", "mpss": "m/s²", "m/s/s": "m/s²",
    "ms-2": "m/s²", "m.s-2": "m/s²", "mg": "mg", "millig": "mg", "ug": "µg", "cm/s2": "cm/s²", "gal": "cm/s²",
    "mm/s2": "mm/s²", "ft/s2": "ft/s²",
    "deg/s": "deg/s", "°/s": "deg/s", "dps": "deg/s", "degs": "deg/s", "deg/sec": "deg/s", "°/sec": "deg/s",
    "rad/s": "rad/s", "rads": "rad/s", "rps": "rad/s", "rad/sec": "rad/s", "mdps": "mdeg/s", "mdeg/s": "mdeg/s",
    "mrad/s": "mrad/s", "deg/h": "deg/h", "dph": "deg/h", "rpm": "rpm", "ut": "uT", "nt": "nT", "mt": "mT", "t": "T",
    "gauss": "gauss", "gs": "gauss", "mgauss": "mgauss",
    "lsb": "LSB", "count": "LSB", "counts": "LSB", "raw": "LSB", "digit": "LSB", "digits": "LSB", "adc": "LSB",
}  # fmt: skip


def canonical(text: str, quantity: Quantity) -> str | None:
    """The unit that a header or a person means: a key of the quantity's factors, `LSB`, or None."""
    spelled = text.strip().lower().replace("µ", "u").replace("μ", "u").replace("²", "2")
    spelled = _in_words(spelled)
    spelled = re.sub(r"[\s^*·()\[\]]", "", spelled).replace("m_s2", "m/s2").replace("sec2", "s2")
    if spelled == "g" and quantity.unit == "uT":
        return "gauss"
    if spelled == "mg" and quantity.unit == "uT":
        return "mgauss"
    found = _SPELLINGS.get(spelled)
    return found if found == "LSB" or found in quantity.factors else None


#: Units as people write them out, and their signs.
_WORDS = (
    (r"^in ", ""), (r"'s?$", ""), (r"\bmicro ?", "u"), (r"\bmilli ?(?=[a-z])", "m"), (r"\bnano ?", "n"),
    (r"metres?|meters?", "m"), (r"radians?", "rad"), (r"degrees?", "deg"), (r"seconds?", "s"), (r"tesla?s?\b", "t"),
    (r"gs$", "g"), (r"gravit(y|ies)$", "g"), (r"gauss(es)?", "gauss"), (r" ?per ", "/"), (r"/s ?squared", "/s2"),
    (r"/s/s", "/s2"),
)  # fmt: skip


def _in_words(text: str) -> str:
    """Lower-case `in radians per second`, `microteslas`, `G's` by their signs."""
    for word, sign in _WORDS:
        text = re.sub(word, sign, text) if len(text) > 2 or word.startswith("^") else text
    return text


def units(unit: str) -> tuple[str, ...]:
    """Units that can be brought to a recipe's `unit`."""
    return tuple(_FACTORS.get(unit, {unit: 1.0}))


def unit_factor(text: str, unit: str) -> float | None:
    """What a value in the unit that a DBC or a person wrote is multiplied by to be in the recipe's `unit`; None where
    it is of no such quantity."""
    if unit in QUANTITIES:
        known = canonical(text, QUANTITIES[unit])
        return None if known is None else QUANTITIES[unit].factors.get(known)
    return _FACTORS.get(unit, {}).get(_ANGLES.get(text.strip().lower(), ""))


#: Angles of inclination; a recording is never recognised by them.
_ANGLES = {
    "deg": "deg", "°": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "mrad": "mrad",
    "mdeg": "mdeg", "cdeg": "cdeg", "arcmin": "arcmin", "'": "arcmin", "arcsec": "arcsec",
}  # fmt: skip
_FACTORS: Mapping[str, Mapping[str, float]] = {
    **{unit: quantity.factors for unit, quantity in QUANTITIES.items()},
    "deg": {
        "deg": 1.0, "rad": 180 / np.pi, "mrad": 0.18 / np.pi, "mdeg": 1e-3, "cdeg": 1e-2, "arcmin": 1 / 60,
        "arcsec": 1 / 3600,
    },
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class UnitScale:
    """reading = (raw − zero) · factor. unit: what the raw numbers are; inferred: by their size, not by a name;
    exact: whether the factor is a unit's own, so that the gain of the sensor stays in the readings; of_header: stated
    by a header alone, which readings may contradict."""

    unit: str
    factor: float
    zero: float = 0.0
    inferred: bool = True
    exact: bool = True
    of_header: bool = False


def from_magnitude(means: Floats, quantity: Quantity, *, whole: bool) -> UnitScale:
    """The scale that the mean raw readings at rest (k, 3) themselves tell; whole: the raw numbers are integers."""
    if quantity.sizes is None or not len(means):
        return UnitScale(quantity.unit, 1.0)
    centre, radius = sphere(means)
    if not radius > 0:
        return UnitScale(quantity.unit, 1.0)
    low, high = (quantity.sizes[0] * (1 - SPREAD), quantity.sizes[1] * (1 + SPREAD))
    usual = [(unit, factor) for unit, factor in quantity.factors.items() if unit in USUAL_UNITS]
    fits = [(unit, factor) for unit, factor in usual if low <= radius * factor <= high]
    if quantity.unit == "uT":
        # A compass lies off its centre by any hard iron, and its counts are of no known size.
        if whole:
            least, most = quantity.sizes
            fits = [
                (unit, factor) for unit, factor in fits if unit not in LIKE_COUNTS and least <= radius * factor <= most
            ]
        return UnitScale(*fits[0]) if fits else UnitScale("LSB", USUAL_FIELD_UT / radius, exact=False)
    off_centre = float(np.abs(centre).max()) > FAR_OFF * radius
    if off_centre and np.ptp(centre) > radius:
        # No sensor is off like that on one axis: the unit was driven or hardly turned, and gravity is the centre.
        centre, radius, off_centre = np.zeros(3), float(np.median(np.linalg.norm(means, axis=1))), False
        fits = [(unit, factor) for unit, factor in usual if low <= radius * factor <= high]
    if fits and not off_centre and not (whole and _counts(radius) and radius > LEAST_COUNTS):
        return UnitScale(*fits[0])
    bits = _counts(radius) if whole or radius > LEAST_COUNTS else 0
    zero = float(2 ** round(np.log2(np.abs(np.median(centre))))) if off_centre and np.median(centre) > 0 else 0.0
    return UnitScale("LSB", 1 / (bits or radius), zero, exact=bool(bits))


def from_rates(means: Floats, rates: Floats, quantity: Quantity, *, whole: bool) -> UnitScale:
    """The scale that mean raw turn rates (k, 3) tell beside those of a recipe's positions (p, 3), deg/s, by the axis
    that turns fastest; whole: the raw numbers are integers, and counts where they are far more than deg/s. A range that
    is set wrong is no unit: deg/s otherwise."""
    wide, turned = (float(np.max(np.ptp(x, axis=0), initial=0.0)) for x in (means, rates))
    if not (wide > 0 and turned > 0):
        return UnitScale(quantity.unit, 1.0)
    ratio = turned / wide
    for unit in USUAL_RATES:
        if abs(np.log(ratio / quantity.factors[unit])) < np.log1p(SPREAD):
            return UnitScale(unit, quantity.factors[unit])
    return UnitScale("LSB", ratio, exact=False) if whole and ratio * LEAST_A_DEG < 1 else UnitScale(quantity.unit, 1.0)


def is_converter_middle(centre: Floats, radius: float) -> bool:
    """Whether a centre (3) is the middle of a converter's range: one large number for all axes."""
    return bool(np.median(centre) > FAR_OFF * radius and np.ptp(centre) < radius and np.median(centre) > LEAST_COUNTS)


def _counts(radius: float) -> int:
    """The power of two that a magnitude in counts stands for; 0 where none is near."""
    if not radius > 16:
        return 0
    power = int(2 ** round(np.log2(radius)))
    return power if abs(radius / power - 1) < COUNTS_SPREAD else 0


def sphere(points: Floats) -> tuple[Floats, float]:
    """Centre (3) and radius of the sphere through points (k, 3); about zero where they do not span one: a few
    poses, or one that drifts, lie on many spheres."""
    size = float(np.median(np.linalg.norm(points, axis=1)))
    if not size > 0:
        return np.zeros(3), 0.0
    scaled = points / size
    design = np.c_[2 * scaled, np.ones(len(scaled))]
    if len(points) >= 5 and np.linalg.cond(design) < 1e6:
        found = np.linalg.lstsq(design, (scaled**2).sum(axis=1), rcond=None)[0]
        radius = float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))
        if spans(scaled, found[:3], radius):
            return np.asarray(found[:3] * size), radius * size
    return np.zeros(3), size


def spans(points: Floats, centre: Floats, radius: float) -> bool:
    """Whether points (k, 3) lie all about a sphere and not in one part of it."""
    reach = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points))
    off = float(np.sqrt(np.mean((np.linalg.norm(points - centre, axis=1) - radius) ** 2)))
    return bool(reach >= LEAST_REACH * radius and off <= MOST_OFF * radius)
