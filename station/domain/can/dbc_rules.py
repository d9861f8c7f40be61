"""What can be wrong with a DBC that its parser lets pass. Each rule is a few lines; none knows the others."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from station.domain.can.signals import FrameLayout, SignalLayout
from station.messages import Message

#: Physical limits are decimal text, often rounded, often the power of two itself: a step, or a thousandth of what the
#: bits hold, beyond their end says nothing against scale and length.
SLACK_STEPS, SLACK_SPAN = 1.0, 1e-3


@dataclass(frozen=True, slots=True)
class DbcIssue:
    """One mistake: in which message, at which signal (None: the message itself), what, and the remedy."""

    message: str
    signal: str | None
    mistake: Message


def lint(layouts: Sequence[FrameLayout], used: Mapping[str, Collection[str]] | None = None) -> tuple[DbcIssue, ...]:
    """Every mistake in a DBC's messages, in the order of the file; used: only in these signals by message."""
    if used is not None:
        return tuple(f for f in lint([_only(m, used) for m in layouts if m.name in used]))
    found = list(_duplicates(layouts))
    for message in layouts:
        found += [DbcIssue(message.name, None, mistake) for mistake in _message_rules(message)]
        for signal in message.signals:
            found += [DbcIssue(message.name, signal.name, mistake) for rule in RULES for mistake in rule(signal)]
            found += [DbcIssue(message.name, signal.name, mistake) for mistake in _multiplexing(message, signal)]
    return tuple(found)


def _only(message: FrameLayout, used: Mapping[str, Collection[str]]) -> FrameLayout:
    """A message with the signals that are used, and the multiplexers that select them."""
    names = set(used[message.name])
    while more := {s.selector for s in message.signals if s.name in names and s.selector} - names:
        names |= more
    return replace(message, signals=tuple(s for s in message.signals if s.name in names))


def _duplicates(layouts: Sequence[FrameLayout]) -> Iterator[DbcIssue]:
    ids: dict[int, str] = {}
    names: set[str] = set()
    for message in layouts:
        if message.can_id in ids:
            can_id = message.can_id & 0x1FFF_FFFF
            mistake = Message("dbc-identifier-twice", can_id=can_id, other=ids[message.can_id])
            yield DbcIssue(message.name, None, mistake)
        if message.name in names:
            yield DbcIssue(message.name, None, Message("dbc-message-twice"))
        ids.setdefault(message.can_id, message.name)
        names.add(message.name)


def _message_rules(message: FrameLayout) -> Iterator[Message]:
    names = [s.name for s in message.signals]
    for name in sorted({n for n in names if names.count(n) > 1}):
        yield Message("dbc-signal-twice", signal=name)
    if message.length == 0 and names:
        yield Message("dbc-empty-message")


def _scale(signal: SignalLayout) -> Iterator[Message]:
    if signal.scale == 0:
        yield Message("dbc-scale-zero")
    if not (math.isfinite(signal.scale) and math.isfinite(signal.offset)):
        yield Message("dbc-scale-not-finite")


def _order(signal: SignalLayout) -> Iterator[Message]:
    low, high = signal.minimum, signal.maximum
    if low is not None and high is not None and low > high:
        yield Message("dbc-limits-swapped", low=low, high=high)


def _range(signal: SignalLayout) -> Iterator[Message]:
    if signal.is_float or signal.scale == 0:
        return
    low, high = sorted(raw * signal.scale + signal.offset for raw in signal.raw_limits())
    slack = max(abs(signal.scale) * SLACK_STEPS, (high - low) * SLACK_SPAN) * (1 + 1e-9)
    named: tuple[tuple[str, float | None], ...] = (("minimum", signal.minimum), ("maximum", signal.maximum))
    reach = {"bits": signal.length, "low": low, "high": high}
    never_negative = not signal.signed and signal.offset == 0 and signal.scale > 0
    if never_negative and signal.minimum is not None and signal.minimum < 0:
        yield Message("dbc-limit-negative", which="minimum", limit=signal.minimum)
        named = named[1:]
    beyond = [(which, v) for which, v in named if v is not None and not low - slack <= v <= high + slack]
    if len(beyond) == 2:
        yield Message("dbc-limits-unreachable", minimum=beyond[0][1], maximum=beyond[1][1], **reach)
        return
    for which, limit in beyond:
        yield Message("dbc-limit-unreachable", which=which, limit=limit, **reach)


def _float_length(signal: SignalLayout) -> Iterator[Message]:
    if signal.is_float and signal.length not in (16, 32, 64):
        yield Message("dbc-float-length", bits=signal.length)
    if not 1 <= signal.length <= 64:
        yield Message("dbc-length", bits=signal.length)


#: Signs that units are written with, in every encoding that DBC editors use.
UNIT_SIGNS = "°²³µμΩ·"


def _ascii(signal: SignalLayout) -> Iterator[Message]:
    if not "".join(c for c in signal.unit if c not in UNIT_SIGNS).isascii():
        yield Message("dbc-unit-not-ascii", unit=signal.unit)


RULES: tuple[Callable[[SignalLayout], Iterator[Message]], ...] = (_scale, _order, _range, _float_length, _ascii)


def _multiplexing(message: FrameLayout, signal: SignalLayout) -> Iterator[Message]:
    if signal.selector is None:
        return
    selectors = [s for s in message.signals if s.name == signal.selector]
    if not selectors:
        yield Message("dbc-multiplexer-missing", multiplexer=signal.selector)
        return
    if selectors[0].is_float:
        yield Message("dbc-multiplexer-float", multiplexer=signal.selector)
        return
    low, high = selectors[0].raw_limits()
    for value in signal.selected_by:
        if not low <= value <= high:
            yield Message("dbc-multiplexer-range", multiplexer=signal.selector, value=value, low=low, high=high)
