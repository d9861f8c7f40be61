"""What can be wrong with a DBC that its parser lets pass. Each rule is a few lines; none knows the others."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from station.domain.can.signals import FrameLayout, SignalLayout

#: Physical limits are decimal text; half a step beyond the bits' own limit is rounding.
SLACK_STEPS = 0.5


@dataclass(frozen=True, slots=True)
class DbcIssue:
    """One mistake: in which message, at which signal (None: the message itself), what, and the remedy."""

    message: str
    signal: str | None
    text: str


def lint(layouts: Sequence[FrameLayout]) -> tuple[DbcIssue, ...]:
    """Every mistake in a DBC's messages, in the order of the file."""
    found = list(_duplicates(layouts))
    for message in layouts:
        found += [DbcIssue(message.name, None, text) for text in _message_rules(message)]
        for signal in message.signals:
            found += [DbcIssue(message.name, signal.name, text) for rule in RULES for text in rule(signal)]
            found += [DbcIssue(message.name, signal.name, text) for text in _multiplexing(message, signal)]
    return tuple(found)


def _duplicates(layouts: Sequence[FrameLayout]) -> Iterator[DbcIssue]:
    ids: dict[int, str] = {}
    names: set[str] = set()
    for message in layouts:
        if message.can_id in ids:
            text = f"identifier {message.can_id & 0x1FFF_FFFF:#x} is also that of {ids[message.can_id]}"
            yield DbcIssue(message.name, None, f"{text}; give each message its own")
        if message.name in names:
            yield DbcIssue(message.name, None, "the name is used by two messages; give each its own")
        ids.setdefault(message.can_id, message.name)
        names.add(message.name)


def _message_rules(message: FrameLayout) -> Iterator[str]:
    names = [s.name for s in message.signals]
    for name in sorted({n for n in names if names.count(n) > 1}):
        yield f"signal {name} is listed twice; give each its own name"
    if message.length == 0 and names:
        yield "the message is 0 bytes long but has signals; correct its length"


def _scale(signal: SignalLayout) -> Iterator[str]:
    if signal.scale == 0:
        yield "scale is 0, so every value would be the offset; correct it"
    if not (math.isfinite(signal.scale) and math.isfinite(signal.offset)):
        yield "scale or offset is no number; correct it"


def _order(signal: SignalLayout) -> Iterator[str]:
    low, high = signal.minimum, signal.maximum
    if low is not None and high is not None and low > high:
        yield f"minimum {low:g} is above maximum {high:g}; exchange them"


def _range(signal: SignalLayout) -> Iterator[str]:
    if signal.is_float or signal.scale == 0:
        return
    ends = [raw * signal.scale + signal.offset for raw in signal.raw_limits()]
    slack = abs(signal.scale) * SLACK_STEPS
    for what, limit in (("minimum", signal.minimum), ("maximum", signal.maximum)):
        if limit is None or min(ends) - slack <= limit <= max(ends) + slack:
            continue
        if not signal.signed and signal.offset == 0 and signal.scale > 0 > limit:
            yield f"{what} {limit:g} is negative but the signal is unsigned; write @1- or @0-, or correct the limit"
        else:
            sign = "signed" if signal.signed else "unsigned"
            yield (
                f"{what} {limit:g} cannot be reached: {signal.length} {sign} bits "
                f"hold {min(ends):g} to {max(ends):g}; correct the limit"
            )


def _float_length(signal: SignalLayout) -> Iterator[str]:
    if signal.is_float and signal.length not in (16, 32, 64):
        yield f"a float of {signal.length} bits does not exist; it has 16, 32 or 64"
    if not 1 <= signal.length <= 64:
        yield f"length {signal.length} is not 1 to 64 bits; correct it"


def _ascii(signal: SignalLayout) -> Iterator[str]:
    if not signal.unit.isascii():
        yield f"unit {signal.unit!r} is not plain ASCII, which readers take differently; write deg, degC, u"


RULES: tuple[Callable[[SignalLayout], Iterator[str]], ...] = (_scale, _order, _range, _float_length, _ascii)


def _multiplexing(message: FrameLayout, signal: SignalLayout) -> Iterator[str]:
    if signal.selector is None:
        return
    selectors = [s for s in message.signals if s.name == signal.selector]
    if not selectors:
        yield f"multiplexer {signal.selector} does not exist; add it or correct the name"
        return
    if selectors[0].is_float:
        yield f"multiplexer {signal.selector} is a float; it must be an integer"
        return
    low, high = selectors[0].raw_limits()
    for value in signal.selected_by:
        if not low <= value <= high:
            yield f"multiplexer {signal.selector} cannot take the value {value}; its bits hold {low} to {high}"
