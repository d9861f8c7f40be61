"""The order of things: intents before deeds, facts after them, and PASS only once its record is on the disk."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from station.domain.core.types import Outcome
from station.domain.run.progress import Event, UnitDone
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran

#: Coefficients, checksum'd objects, valid flag: what a calibration changes. Output and event timer are switches.
CALIBRATION = range(0x2100, 0x2106)
SAVE = 0x1010


class Watched:
    """A port that hands on every call and notes the ones of `names`, as they begin and after they returned."""

    def __init__(self, port: Any, names: tuple[str, ...], observed: list[tuple[Any, ...]]) -> None:
        self._port, self._names, self._observed = port, names, observed

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._port, name)
        if name not in self._names:
            return found

        def call(*args: Any, **kwargs: Any) -> Any:
            self._observed.append((name, "begins", *args))
            result = found(*args, **kwargs)
            self._observed.append((name, "done", *args))
            return result

        return call


def watching(observed: list[tuple[Any, ...]]) -> Callable[[Bench], Bench]:
    def wrap(bench: Bench) -> Bench:
        there = bench.station
        devices = {n.node: Watched(there.device(n.node), ("download",), observed) for n in there.settings.nests}
        store: Any = Watched(there.store, ("begin", "write", "result", "finish"), observed)
        return replace(bench, station=replace(there, store=store, device=devices.__getitem__))

    return wrap


def test_pass_is_shown_only_after_its_record_is_kept(tmp_path: Path) -> None:
    shown = []

    def hook(event: Event, _stop: StopRequest, _bench: Bench) -> None:
        if isinstance(event, UnitDone):
            serial = event.result.seat.serial
            # Another reader of the file, at the moment at which anybody can first know of the PASS.
            shown.append((event.result.outcome, Ran(tmp_path).life(serial)["outcome"]))

    fixture_run.run(tmp_path, units=3, hook=hook)
    assert shown == [(Outcome.PASS, "PASS")] * 3


def test_intents_come_before_deeds_and_facts_after_them(tmp_path: Path) -> None:
    observed: list[tuple[Any, ...]] = []
    fixture_run.run(tmp_path, wrap=watching(observed))
    assert observed[0][:2] == ("begin", "begins"), "the attempt comes before any deed"
    planned = next(i for i, s in enumerate(observed) if s[:2] == ("result", "done") and s[3] == "write-plan")
    begun = [(i, s[2]) for i, s in enumerate(observed) if s[:2] == ("download", "begins")]
    actions = [(i, index) for i, index in begun if index in CALIBRATION or index == SAVE]
    assert len(actions) > 12
    for at, index in actions:
        assert at > planned, "the whole plan stands in the log before the first write"
        name, when, _attempt, *stages = observed[at - 1]
        assert (name, when) == ("write", "done")
        record = stages[-1]  # before it the same commit may hold the fact of the write before
        assert (record.index, record.stage) == (index, "intent")
        after = next(s for s in observed[at + 2 :] if s[:2] == ("write", "begins"))
        assert (after[3].index, after[3].sub) == (record.index, record.sub)
        assert after[3].stage in ("written", "verified")
    assert observed[-1][:2] == ("finish", "done")
