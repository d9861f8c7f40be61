"""All streams of one station and recipe watched together; each change is one alert, open until it is put right.

A stream alarms when its evidence, times its share, reaches K · ARL, K components in all; exchangeable values then give
it at most share · n / (K · ARL) alarms within n loads on average (ShiftDetector). The shares add up to K, and
expectations add up, however the streams depend on each other: the bank gives at most n / ARL false alarms.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch import change_point
from station.domain.watch.change_point import Change
from station.domain.watch.e_detector import LEARN, likelihood_ratios
from station.domain.watch.put_right import ReturnTest
from station.domain.watch.signals import WatchedSignal
from station.domain.watch.stream import PlaceValues, Stream, streams_of

DEFAULT_RUN_LENGTH = 1000
#: Beginnings this many loads apart, or this share of the loads since then, are one change; so are any that the loads
#: tell apart by less than 1000 : 1, for as rarely does another change begin while an alert is open.
_SAME_LOADS, _SAME_SHARE, _SAME_NATS = 5, 0.25, math.log(1000)
#: An open alert is estimated anew when so many more loads came, as a share of those since it began.
_RENEWED_SHARE = 0.01
#: Causes whose log likelihoods are this near cannot be told apart.
_NEAR_NATS = 3.0


@dataclass(frozen=True, slots=True)
class WatchedPlace:
    """One signal at one nest; nest "": the mean over the nests of a load."""

    signal: WatchedSignal
    nest: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class LoadValues:
    """number: of the load, from 1; values: components (m) by place."""

    number: int
    values: Mapping[WatchedPlace, Floats]


@dataclass(slots=True, eq=False)
class Alert:
    """One change. place: the likeliest; others: places that the data cannot tell from it; begin, low, high: loads;
    raised: the load at which it was found; ended: the first load put right, None while it lasts; changes: by component
    of the place; loads: the newest load in them; watched: (place, stream) that alarmed, the first of them first;
    returning: of the components that it shows in, whether they are as before."""

    place: WatchedPlace
    others: tuple[WatchedPlace, ...]
    begin: int
    low: int
    high: int
    raised: int
    changes: tuple[Change, ...]
    loads: int
    ended: int | None = None
    watched: list[tuple[WatchedPlace, int]] = field(default_factory=list)
    returning: ReturnTest | None = None


class WatchBank:
    """components: how many there will be, None: as many as have come so far; run_length: loads to a false alarm."""

    def __init__(self, components: int | None = None, run_length: float = DEFAULT_RUN_LENGTH) -> None:
        self._expected, self.run_length = components, run_length
        self._streams: dict[WatchedPlace, list[Stream]] = {}
        self.open: list[Alert] = []
        self.loads = 0

    @property
    def threshold(self) -> float:
        """Evidence at which a stream alarms."""
        return max(self._expected or 0, self.components) * self.run_length

    @property
    def components(self) -> int:
        """Of all places so far."""
        return sum(streams[0].known.components for streams in self._streams.values())

    @property
    def testing(self) -> bool:
        """Whether enough loads are learnt for the first test."""
        return self.loads > LEARN

    def add(self, load: LoadValues) -> tuple[list[Alert], list[Alert]]:
        """One load more: alerts that it raised, and alerts that it showed to be put right."""
        self.loads += 1
        suspended = {key for alert in self.open for place, i in alert.watched for key in self._explained(place, i)}
        for place, values in load.values.items():
            if place not in self._streams:
                self._streams[place] = streams_of(PlaceValues(len(values)), str(place))
            self._streams[place][0].known.add(load.number, values)
        self._test(load, suspended)
        ended = [alert for alert in self.open if self._is_righted(alert, load)]
        for alert in ended:
            self._forget(alert)
        raised = [self._raise(key, load.number) for key in self._alarms(suspended)]
        return [alert for alert in raised if alert is not None], ended

    def refresh(self, alert: Alert) -> None:
        """What all loads so far say of it: place, beginning and size; the same as before while they are hardly more."""
        if self._streams[alert.place][0].loads[-1] - alert.loads < _RENEWED_SHARE * (alert.loads - alert.begin):
            return
        stream = max((self._streams[place][i] for place, i in alert.watched), key=lambda s: _nats([s], alert.begin))
        found = _find(stream, stream.first_near(stream.first_after(alert.low)))
        if found is not None:
            alert.begin, alert.low, alert.high = (stream.loads[i] for i in (found.begin, found.low, found.high))
            self._name(alert)

    def _test(self, load: LoadValues, suspended: set[tuple[WatchedPlace, int]]) -> None:
        """The newest values as evidence."""
        found = [
            (stream, share)
            for place in load.values
            for i, stream in enumerate(self._streams[place])
            if (place, i) not in suspended and (share := stream.rank()) is not None
        ]
        for (stream, _), ratios in zip(found, likelihood_ratios([share for _, share in found]), strict=True):
            stream.detector.add(ratios)

    def _alarms(self, suspended: Iterable[tuple[WatchedPlace, int]]) -> list[tuple[WatchedPlace, int]]:
        threshold, left_out = self.threshold, set(suspended)
        over = [
            (stream.evidence, (place, i))
            for place, streams in self._streams.items()
            for i, stream in enumerate(streams)
            if (place, i) not in left_out and stream.evidence >= threshold
        ]
        return [key for _, key in sorted(over, key=lambda found: -found[0])]

    def _raise(self, key: tuple[WatchedPlace, int], load: int) -> Alert | None:
        """A new alert; None where the change belongs to an open one."""
        stream = self._streams[key[0]][key[1]]
        change = _find(stream, stream.first_recent())
        if change is None:
            return None
        begin, low, high = (stream.loads[i] for i in (change.begin, change.low, change.high))
        stream.changed(change.begin)
        for alert in self.open:
            apart = max(_SAME_LOADS, int(_SAME_SHARE * (load - alert.begin + 1)))
            if low - apart <= alert.begin <= high + apart or _began_with(alert, stream, apart):
                alert.watched.append(key)
                return None
        alert = Alert(key[0], (), begin, low, high, load, (change,), load, watched=[key])
        self._name(alert)
        self.open.append(alert)
        return alert

    def _name(self, alert: Alert) -> None:
        """The place that the change shows in most, and those near it."""
        nats = {place: _nats(self._components(place), alert.begin) for place in self._streams}
        best = max(nats, key=lambda place: nats[place])
        alert.place = best
        near = (p for p, n in nats.items() if p != best and n >= nats[best] - _NEAR_NATS)
        alert.others = tuple(sorted(near, key=lambda place: -nats[place]))
        alert.changes = self._changes(best, alert.begin)
        alert.loads = self._streams[best][0].loads[-1]
        alert.returning = None

    def _changes(self, place: WatchedPlace, load: int) -> tuple[Change, ...]:
        """Of each component, as from a load on; a drift only where the components' own maximum is one."""
        found = []
        for stream in self._components(place):
            begin = stream.first_after(load)
            if not 0 < begin < len(stream):
                return ()
            first = stream.first_near(begin)
            own = _find(stream, first)
            drifting = own is not None and own.slope != 0 and abs(own.begin - begin) <= max(_SAME_LOADS, begin // 4)
            found.append(change_point.at(stream.values(first), begin - first, drifting=drifting))
        return tuple(found)

    def _explained(self, place: WatchedPlace, i: int) -> list[tuple[WatchedPlace, int]]:
        """The streams of a place that a change in one of them shows in: all that are along any of its components."""
        streams = self._streams[place]
        return [(place, k) for k, other in enumerate(streams) if np.abs(streams[i].direction) @ np.abs(other.direction)]

    def _components(self, place: WatchedPlace) -> list[Stream]:
        """The streams along single components."""
        streams = self._streams[place]
        return streams[: streams[0].known.components]

    def _is_righted(self, alert: Alert, load: LoadValues) -> bool:
        """Whether those components of the place that the change shows in are as before; notes since which load."""
        if alert.place not in load.values or not alert.changes:
            return False
        most = max(c.nats for c in alert.changes)
        pairs = zip(self._components(alert.place), alert.changes, strict=True)
        shown = [(s, c) for s, c in pairs if c.nats >= min(most, _NEAR_NATS)]
        first = shown[0][0].first_after(alert.begin)
        if alert.returning is None:
            alert.returning = ReturnTest(np.array([(c.after - c.before) / c.std for _, c in shown]))
        begin = first + len(alert.returning)
        alert.returning.extend(np.array([(s.values(begin) - c.before) / c.std for s, c in shown]).T)
        found = alert.returning.righted_since()
        if found is not None:
            alert.ended = shown[0][0].loads[first + found]
        return found is not None

    def _forget(self, alert: Alert) -> None:
        """The loads of the change count no more at any place that it shows at and that no other alert holds."""
        self.open.remove(alert)
        held = {place for other in self.open for place, _ in other.watched}
        watched = {place for place, _ in alert.watched}
        for place, streams in self._streams.items():
            if place not in held and (place in watched or any(_shows(stream, alert) for stream in streams)):
                known = streams[0].known
                known.keep(known.first_after(alert.begin))
                for stream in streams:
                    stream.changed(len(stream))
        for other in self.open:
            other.returning = None


def _find(stream: Stream, first: int) -> Change | None:
    """The likeliest change in the values from the first on; its indices are those of all values."""
    found = change_point.find(stream.values(first))
    if found is None:
        return None
    return replace(found, begin=first + found.begin, low=first + found.low, high=first + found.high)


def _nats(streams: Sequence[Stream], load: int) -> float:
    """Log likelihood ratio of a change in all of them with this load, less what chance gives them."""
    known = [(s, begin) for s in streams if 1 < (begin := s.first_after(load)) < len(s)]
    changes = [change_point.at(*stream.near(begin)) for stream, begin in known]
    return sum(c.nats for c in changes) - len(changes) / 2 if changes else -math.inf


def _began_with(alert: Alert, stream: Stream, apart: int) -> bool:
    """Whether what the stream shows may well have begun with the alert, however its own noise has it."""
    first = stream.first_recent()
    begin = stream.first_after(alert.begin) - first
    return begin > 0 and change_point.nats_against(stream.values(first), begin, apart) < _SAME_NATS


def _shows(stream: Stream, alert: Alert) -> bool:
    begin, end = stream.first_after(alert.begin), stream.first_after(alert.ended or alert.begin)
    return 0 < begin < end and change_point.at(*stream.near(begin, end)).nats >= _NEAR_NATS
