"""The run: a generator of frozen events. The face prints them, the page streams them; the log is written inside."""

from collections.abc import Callable, Generator, Sequence

from station.domain.core.types import NestAssignment
from station.domain.run.progress import Event
from station.messages import Message
from station.service.alerts import record_alerts
from station.service.load import Load
from station.service.station import Job, Station
from station.service.stop_request import StopRequest


class Runner:
    """Takes fixture loads through the recipe. stop: the operator's; confirm: asks a person for something and waits."""

    def __init__(
        self,
        station: Station,
        job: Job,
        stop: StopRequest | None = None,
        confirm: Callable[[Message], None] = lambda _: None,
    ) -> None:
        self._station, self._job = station, job
        self._stop = stop or StopRequest()
        self._confirm = confirm

    def run(self, seats: Sequence[NestAssignment]) -> Generator[Event, None, None]:
        """One fixture load of 1..N units. Whatever happens, and whoever stops listening, attempts end in the log
        and the positioner is parked."""
        load = Load(self._station, self._job, self._stop, self._confirm)
        try:
            yield from load.run(seats)
        finally:
            load.leave()
            # The operator is changing the units meanwhile.
            record_alerts(self._station.store, self._station.alerts())
            self._station.store.tidy()
