"""The face of a recovery: find the nest, ask the service, say what the unit holds."""

from station.cli import _output
from station.domain.core.types import NestAssignment
from station.domain.run.run_state import with_unit
from station.errors import UsageError
from station.messages import Message, render
from station.ports.log_reader import Query
from station.service import recovery
from station.service.identify import identify_for_recovery
from station.service.unit import Unit
from station.wiring.bench import Bench, open_bench
from station.wiring.logs import open_log
from station.wiring.run_order import RunOrder

#: A unit that holds a mixture fails; one that holds all old or all new values is sound.
_EXIT_CODES = {"old": 0, "new": 0, "mixed": 1, "other": 1}


def recover_unit(order: RunOrder, serial: str, nest: str | None, how: str | None, *, as_json: bool) -> int:
    """Looks at the unit, and recovers it when told how; the exit code."""
    if order.database is not None and not order.database.exists():
        raise UsageError("log-missing", path=str(order.database))
    with open_bench(order) as bench:
        for sentence in bench.notices:
            _output.print_remark(sentence)
        seat = _seat(bench, serial, nest)
        suspect = bench.station.store.suspect(serial)
        if suspect is None:
            return _nothing_open(bench, serial, as_json=as_json)
        bench.fixture.place([seat])
        unit = Unit(seat, suspect.attempt, bench.station.device(seat.node), bench.station.clock.monotonic_s())
        identify_for_recovery(unit, bench.job)
        state = recovery.read_device_state(unit, suspect, bench.station)
        if how is not None:
            state = recovery.recover(unit, suspect, bench.station, bench.job, restore=how == "restore")
    if as_json:
        _output.print_json(
            {"schema": "station.recovery/1", "serial": serial, "attempt": suspect.attempt, "state": state}
        )
    else:
        _output.print_line(render(with_unit(serial, recovery.device_state(state))))
    return _EXIT_CODES[state]


def _nothing_open(bench: Bench, serial: str, *, as_json: bool) -> int:
    """No attempt left the unit half written, or what was left is settled. Errors: UsageError for an unknown unit."""
    with open_log(bench.database) as log:
        if not log.attempts(Query(serial=serial), 1):
            raise UsageError("recover-unit-unknown", log=str(bench.database), serial=serial)
    if as_json:
        _output.print_json({"schema": "station.recovery/1", "serial": serial, "attempt": None, "state": "settled"})
    else:
        _output.print_message(Message("recover-nothing-open", log=str(bench.database), serial=serial))
    return 0


def _seat(bench: Bench, serial: str, nest: str | None) -> NestAssignment:
    """Where the unit sits. Errors: UsageError for a nest that config.yaml does not have."""
    nests = {n.name: n for n in bench.station.settings.nests}
    name = nest or next(iter(nests))
    if name not in nests:
        raise UsageError("unknown-nest", nest=name[:40], nests=tuple(nests))
    return NestAssignment(serial, name, nests[name].node)
