"""The pace at which a simulated run can be watched and stopped."""

import time
from collections.abc import Callable

from station.service.stop_request import StopRequest

#: A paced run looks this often whether it was stopped, s.
_POLL_S = 0.02


class RealTimePacer:
    """Holds a run on virtual time back to `factor` times real time, so that a person can watch and stop it."""

    def __init__(self, factor: float | None, virtual_s: Callable[[], float], stop: StopRequest) -> None:
        self._factor, self._virtual_s, self._stop = factor, virtual_s, stop
        self._began = (virtual_s(), time.monotonic())

    def skip(self, waited_s: float) -> None:
        """Real time that passed while virtual time stood still, because a person did something, is not made up for."""
        self._began = (self._began[0], self._began[1] + waited_s)

    def keep(self) -> None:
        """Waits until real time has caught up; a stop ends the wait."""
        if self._factor is None:
            return
        until_s = self._began[1] + (self._virtual_s() - self._began[0]) / self._factor
        while not self._stop.requested and (remaining_s := until_s - time.monotonic()) > 0:
            time.sleep(min(_POLL_S, remaining_s))
