"""Makes the missing readings of a study: load by load, every part through every nest."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing

from station.cli import _output
from station.cli._confirm import wait_for_person
from station.cli._stop_signals import stop_signals, stop_socket
from station.domain.core.types import NestAssignment
from station.domain.run.progress import LoadDone
from station.messages import Message
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench, open_bench
from station.wiring.run_order import RunOrder

#: A serial and a nest's name.
StudyCell = tuple[str, str]


def measure_missing(order: RunOrder, wanted: Mapping[StudyCell, int], there: Mapping[StudyCell, int]) -> None:
    """Runs every load that is missing. Errors: those of a run; what was measured until then stays."""
    loads = list(missing_loads(wanted, there))
    if not loads:
        return
    stop = StopRequest()
    with open_bench(order) as bench, stop_signals(stop), stop_socket(bench.database, stop), _output.progress() as bar:
        task = bar.add_task("loads of the study", total=len(loads))
        for cells in loads:
            _run_load(bench, cells, stop)
            bar.advance(task)


def missing_loads(wanted: Mapping[StudyCell, int], there: Mapping[StudyCell, int]) -> Iterator[list[StudyCell]]:
    """Loads that bring every cell to its count: each nest and each part at most once in a load, cyclic Latin square."""
    remaining = Counter({cell: count - there.get(cell, 0) for cell, count in wanted.items()})
    parts, nests = (list(dict.fromkeys(cell[i] for cell in wanted)) for i in (0, 1))
    while any(count > 0 for count in remaining.values()):
        for turn in range(len(parts)):
            cells = [(parts[(turn + i) % len(parts)], nest) for i, nest in enumerate(nests)]
            load = [cell for cell in cells if remaining[cell] > 0]
            remaining.subtract(load)
            if load:
                yield load


def _run_load(bench: Bench, cells: Sequence[StudyCell], stop: StopRequest) -> None:
    nodes = {n.name: n.node for n in bench.station.settings.nests}
    seats = [NestAssignment(serial, nest, nodes[nest]) for serial, nest in cells]
    if not bench.simulated:
        with stop:  # nothing is being written: a signal may end the wait at once
            wait_for_person(Message("load-units", units=", ".join(f"{s.serial} ({s.nest})" for s in seats)))
    bench.fixture.place(seats)
    confirm = (lambda _: None) if bench.simulated else wait_for_person
    with closing(Runner(bench.station, bench.job, stop, confirm).run(seats)) as events:
        for event in events:
            if isinstance(event, LoadDone) and event.fault is not None:
                raise event.fault
