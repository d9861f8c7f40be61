"""A recipe for a new product: the shipped one of its kind of sensor, with the product's own data sheet."""

import re

from station.domain.can.signals import SignalLayout
from station.domain.product.draft.product_text import EVENT_TIMER_MS, ProductDraft, scalar
from station.domain.product.sending_pdo import EVENT_TIMER
from station.domain.recognition.quantities import QUANTITIES, unit_factor

#: Readings a second where neither file says it.
ASSUMED_RATE_HZ = 100.0
#: Least residual, noise and error of verification that such a step of the reading allows.
STEPS = 3.0
#: Limits of an inclinometer's scale and cross-coupling until a person states the data sheet's.
WIDE = 0.05
_VERIFY = re.compile(r"^verify:.*\n(?: .*\n|\n)*", re.MULTILINE)
#: A sensor must reach so many times what it feels at rest: its gain and offset are not nominal.
ROOM = 1.2
#: The widest angle of the shipped recipe of an inclinometer.
WIDEST_DEG = 60
_ANGLE = re.compile(r"((?:name: [xy][+-])|(?:angle_deg: -?))(\d+)")
_LIMIT = re.compile(r"^(\s*(?:residual|noise|limit): )([0-9.eE+-]+)", re.MULTILINE)


def recipe_text(draft: ProductDraft, template: str, name: str, unit: str) -> str:
    """The file recipes/NAME.yaml. template: the shipped recipe; unit: the sensor's."""
    first = "# yaml-language-server: $schema=../schemas/recipe.json\n"
    first += f"# Drafted by `station init` from {draft.source}, after the shipped recipe of this kind of sensor.\n"
    text = re.sub(r"\A(#.*\n)+", "", template)
    text = re.sub(r"^name: .*$", f"name: {scalar(name)}", text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^product: .*\n", "", text, count=1, flags=re.MULTILINE)
    text = re.sub(r"^(unit: .*)$", rf"\1\nproduct: {scalar(draft.name)}", text, count=1, flags=re.MULTILINE)
    lsb, full_scale = _resolution(draft, unit)
    text = _device(text, draft, lsb, full_scale)
    text = _LIMIT.sub(lambda m: f"{m[1]}{max(float(m[2]), _rounded(STEPS * lsb)):g}", text)
    if "convention: " in text:
        text = re.sub(
            r"^(device: .*)$", r"# check `convention`: what an angle is (docs/recipes.md)\n\1", text, flags=re.M
        )
        text = re.sub(r"^(  (?:gain|cross_axis): ).*$", rf"\g<1>{WIDE}  # check", text, flags=re.M)
        text = _within(text, full_scale)
    if draft.diagonal:
        text = re.sub(r"^(method: .*)$", r"\1\nmodel: offset-gain  # the device keeps gains only", text, flags=re.M)
        text = re.sub(r"^  cross_axis: .*\n", "", text, flags=re.M)
    if not draft.stores:
        text = _VERIFY.sub(_set_aside, text)
    return first + text


def _set_aside(verify: re.Match[str]) -> str:
    """The verification as a comment: without a calibration in the device there is nothing to verify."""
    lines = (f"# {line}" for line in verify[0].rstrip().splitlines())
    return "\n".join(("# Once the map says where the device keeps its calibration:", *lines)) + "\n"


def _within(text: str, full_scale_deg: float) -> str:
    """The positions with their angles made so small that the readings stay within the sensor's range."""
    part = min(1.0, full_scale_deg / (ROOM * WIDEST_DEG))
    return _ANGLE.sub(lambda m: f"{m[1]}{max(1, int(part * int(m[2])))}", text)


def _device(text: str, draft: ProductDraft, lsb: float, full_scale: float) -> str:
    """The block `device:` with what the files say; the rest stays as shipped, and is to be checked."""
    rate_hz = _rate_hz(draft)
    wanted = {"rate_hz": f"{rate_hz or ASSUMED_RATE_HZ:g}", "lsb": f"{lsb:.6g}", "full_scale": f"{full_scale:.6g}"}
    counter = draft.roles.counter
    if counter is not None:
        wanted["counter_bits"] = str(counter.length)
    wanted["axes"] = str(sum(s is not None for s in draft.roles.signals))

    def changed(found: re.Match[str]) -> str:
        block = found[1]
        for key, value in wanted.items():
            block = re.sub(rf"({key}: )[0-9.eE+-]+", lambda m, v=value: m[1] + v, block)
        if counter is None:
            block = re.sub(r", counter_bits: \d+", "", block)
        guess = "" if rate_hz else f"; no file says the rate: {ASSUMED_RATE_HZ:g} Hz is a guess"
        return f"# check with the data sheet: noise and clock are the shipped ones{guess}\n{block}"

    return re.sub(r"^(device: \{.*\})", changed, text, count=1, flags=re.MULTILINE)


def _rate_hz(draft: ProductDraft) -> float | None:
    """By the event timer of the readings' PDO, as the EDS or the draft's own map has it."""
    timer = None if draft.eds is None else draft.eds.entries.get((draft.communication, EVENT_TIMER))
    milliseconds = EVENT_TIMER_MS if draft.makes_send else timer.default if timer is not None else 0
    return 1000 / milliseconds if isinstance(milliseconds, int | float) and milliseconds > 0 else None


def _resolution(draft: ProductDraft, unit: str) -> tuple[float, float]:
    """Step and full scale of the readings, in the sensor's unit."""
    signals = [s for s in draft.roles.signals if s is not None]
    to_unit = unit_factor(draft.roles.unit or unit, unit) or 1.0
    sizes = QUANTITIES[unit].sizes if unit in QUANTITIES else None
    least = ROOM * max(sizes or (0.0,)) / to_unit
    return max(abs(s.scale) for s in signals) * to_unit, min(_full_scale(s, least) for s in signals) * to_unit


def _full_scale(signal: SignalLayout, least: float) -> float:
    """By the DBC's limits; by the bits where these are none, or less than the sensor feels at rest."""
    found = _span(signal.minimum, signal.maximum)
    if found < least or not (signal.minimum or signal.maximum):
        return _span(*(float(raw * signal.scale + signal.offset) for raw in signal.raw_limits()))
    return found


def _span(low: float | None, high: float | None) -> float:
    return min(abs(v) for v in (low, high) if v) if low and high else abs(high or low or 1.0)


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")
