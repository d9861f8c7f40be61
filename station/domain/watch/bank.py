"""All streams of one station and recipe watched together; each change is one alert, open until it is put right.

A stream alarms when its evidence reaches K · ARL, K streams in all; exchangeable values then give it at most
n / (K · ARL) alarms within n loads on average. Expectations add up, however the streams depend on each other: the bank
gives at most n / ARL false alarms.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from station.domain.core.types import Floats
from station.domain.watch import change_point
from station.domain.watch.change_point import Change
from station.domain.watch.e_detector import LEARN, RankShares, ShiftDetector, likelihood_ratios
from station.domain.watch.put_right import righted_since
from station.domain.watch.signals import WatchedSignal

DEFAULT_RUN_LENGTH = 1000
#: Beginnings this many loads apart, or this share of the loads since then, are one change.
_SAME_LOADS, _SAME_SHARE = 5, 0.25
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


class _Stream:
    """One component of one place. loads, values: since the last change that was put right."""

    def __init__(self, name: str) -> None:
        self.loads: list[int] = []
        self.values: list[float] = []
        self.ranks, self.detector = RankShares(name), ShiftDetector()

    def add(self, load: int, value: float) -> None:
        self.loads.append(load)
        self.values.append(value)

    def rank(self) -> float | None:
        """The newest value's rank among those before, as a share; None while it only learns."""
        share = self.ranks.add(self.values[-1])
        return share if len(self.ranks) > LEARN else None

    def first_after(self, load: int) -> int:
        """Index of the first value of this load or later."""
        return int(np.searchsorted(self.loads, load))

    def forget(self, load: int) -> None:
        """Values from this load on are no longer known, and all evidence is."""
        keep = self.first_after(load)
        del self.loads[keep:], self.values[keep:]
        self.ranks.restart(self.values)
        self.detector.restart()


@dataclass(slots=True, eq=False)
class Alert:
    """One change. place: the likeliest; others: places that the data cannot tell from it; begin, low, high: loads;
    raised: the load at which it was found; ended: the first load put right, None while it lasts; changes: by component
    of the place; loads: the newest load in them; watched: (place, component) that alarmed."""

    place: WatchedPlace
    others: tuple[WatchedPlace, ...]
    begin: int
    low: int
    high: int
    raised: int
    changes: tuple[Change, ...]
    loads: int
    ended: int | None = None
    watched: set[tuple[WatchedPlace, int]] = field(default_factory=set)


class WatchBank:
    """streams: how many there will be, None: as many as have come so far; run_length: loads to a false alarm."""

    def __init__(self, streams: int | None = None, run_length: float = DEFAULT_RUN_LENGTH) -> None:
        self._expected, self.run_length = streams, run_length
        self._streams: dict[WatchedPlace, list[_Stream]] = {}
        self.open: list[Alert] = []
        self.loads = 0

    @property
    def threshold(self) -> float:
        """Evidence at which a stream alarms."""
        return max(self._expected or 0, self.streams) * self.run_length

    @property
    def streams(self) -> int:
        """Streams so far."""
        return sum(map(len, self._streams.values()))

    @property
    def testing(self) -> bool:
        """Whether enough loads are learnt for the first test."""
        return self.loads > LEARN

    def add(self, load: LoadValues) -> tuple[list[Alert], list[Alert]]:
        """One load more: alerts that it raised, and alerts that it showed to be put right."""
        self.loads += 1
        suspended = {key for alert in self.open for key in alert.watched}
        for place, values in load.values.items():
            if place not in self._streams:
                self._streams[place] = [_Stream(f"{place}/{i}") for i in range(len(values))]
            for stream, value in zip(self._streams[place], values, strict=True):
                stream.add(load.number, float(value))
        self._test(load, suspended)
        ended = [alert for alert in self.open if self._is_righted(alert, load)]
        for alert in ended:
            self._forget(alert)
        raised = [self._raise(key, load.number) for key in self._alarms(suspended)]
        return [alert for alert in raised if alert is not None], ended

    def refresh(self, alert: Alert) -> None:
        """What all loads so far say of it: place, beginning and size."""
        lead = max(alert.watched, key=lambda key: self._nats(key[0], alert.begin))
        found = self._find(*lead)
        if found is not None:
            change, stream = found
            alert.begin, alert.low, alert.high = (stream.loads[i] for i in (change.begin, change.low, change.high))
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
            (stream.detector.evidence, (place, i))
            for place, streams in self._streams.items()
            for i, stream in enumerate(streams)
            if (place, i) not in left_out and stream.detector.evidence >= threshold
        ]
        return [key for _, key in sorted(over, key=lambda found: -found[0])]

    def _raise(self, key: tuple[WatchedPlace, int], load: int) -> Alert | None:
        """A new alert; None where the change belongs to an open one."""
        found = self._find(*key)
        if found is None:
            return None
        change, stream = found
        begin, low, high = (stream.loads[i] for i in (change.begin, change.low, change.high))
        stream.ranks.restart(stream.values[: change.begin])
        stream.detector.restart()
        for alert in self.open:
            apart = max(_SAME_LOADS, _SAME_SHARE * (load - alert.begin + 1))
            if low - apart <= alert.begin <= high + apart:
                alert.watched.add(key)
                return None
        alert = Alert(key[0], (), begin, low, high, load, (change,), load, watched={key})
        self._name(alert)
        self.open.append(alert)
        return alert

    def _find(self, place: WatchedPlace, i: int) -> tuple[Change, _Stream] | None:
        stream = self._streams[place][i]
        change = change_point.find(stream.values)
        return None if change is None else (change, stream)

    def _name(self, alert: Alert) -> None:
        """The place that the change shows in most, and those near it."""
        nats = {place: self._nats(place, alert.begin) for place in self._streams}
        best = max(nats, key=lambda place: nats[place])
        alert.place = best
        near = (p for p, n in nats.items() if p != best and n >= nats[best] - _NEAR_NATS)
        alert.others = tuple(sorted(near, key=lambda place: -nats[place]))
        alert.changes = self._changes(best, alert.begin)
        alert.loads = self._streams[best][0].loads[-1]

    def _changes(self, place: WatchedPlace, load: int) -> tuple[Change, ...]:
        """Of each component, as from a load on; a drift only where the components' own maximum is one."""
        found = []
        for stream in self._streams[place]:
            begin = stream.first_after(load)
            if not 0 < begin < len(stream.values):
                return ()
            own = change_point.find(stream.values)
            drifting = own is not None and own.slope != 0 and abs(own.begin - begin) <= max(_SAME_LOADS, begin // 4)
            found.append(change_point.at(stream.values, begin, drifting=drifting))
        return tuple(found)

    def _nats(self, place: WatchedPlace, load: int) -> float:
        """Log likelihood ratio of a change in all components there, less what chance gives them."""
        changes = [
            change_point.at(s.values, begin)
            for s in self._streams[place]
            if 1 < (begin := s.first_after(load)) < len(s.values)
        ]
        return sum(c.nats for c in changes) - len(changes) / 2 if changes else -math.inf

    def _is_righted(self, alert: Alert, load: LoadValues) -> bool:
        """Whether those components of the place that the change shows in are as before; notes since which load."""
        if alert.place not in load.values or not alert.changes:
            return False
        most = max(c.nats for c in alert.changes)
        pairs = zip(self._streams[alert.place], alert.changes, strict=True)
        shown = [(s, c) for s, c in pairs if c.nats >= min(most, _NEAR_NATS)]
        first = shown[0][0].first_after(alert.begin)
        since = np.array([(np.array(s.values[first:]) - c.before) / c.std for s, c in shown]).T
        found = righted_since(since, np.array([(c.after - c.before) / c.std for _, c in shown]))
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
                for stream in streams:
                    stream.forget(alert.begin)


def _shows(stream: _Stream, alert: Alert) -> bool:
    begin, end = stream.first_after(alert.begin), stream.first_after(alert.ended or alert.begin)
    return 0 < begin < end and change_point.at(stream.values[:end], begin).nats >= _NEAR_NATS
