"""Error frames as a CAN driver gives them, put on the simulated bus of a run at a chosen instant."""

from collections.abc import Callable

import numpy as np

from station.domain.core.types import ERROR, Frames
from station.ports.bus import Endpoint
from station.ports.clock import EventClock
from station.wiring.bench import Bench

#: Name → class of <linux/can/error.h>, and (byte, bit) of the payload where the class has details.
KINDS: dict[str, tuple[int, tuple[int, int] | None]] = {
    "bus-off": (0x040, None),
    "restarted": (0x100, None),
    "no-acknowledge": (0x020, None),
    "overflow": (0x004, (1, 0x01)),
    "warning": (0x004, (1, 0x04)),
    "error-passive": (0x004, (1, 0x10)),
    "bit-error": (0x008, (2, 0x01)),
    "stuff-error": (0x008, (2, 0x04)),
    "broken-wire": (0x010, (4, 0x04)),
}


def error_frame(kind: str, time_ns: int) -> Frames:
    """One error frame."""
    bits, detail = KINDS[kind]
    data = np.zeros((1, 8), np.uint8)
    if detail is not None:
        data[0, detail[0]] = detail[1]
    return Frames(np.array([time_ns]), np.array([ERROR | bits], np.uint32), np.array([8], np.uint8), data)


class Trouble:
    """An actor that sends one error frame at each instant; several kinds come in the order of `plan`."""

    def __init__(self, channel: Endpoint, clock: EventClock, plan: list[tuple[float, str]]) -> None:
        self._channel, self._clock, self._plan = channel, clock, sorted(plan)

    def next_due_s(self) -> float:
        """When the next one comes."""
        return self._plan[0][0] if self._plan else float("inf")

    def act(self, now_s: float) -> None:
        """Sends what is due."""
        while self._plan and self._plan[0][0] <= now_s:
            self._channel.send_many(error_frame(self._plan.pop(0)[1], self._clock.epoch_ns()))


def troubled(*plan: tuple[float, str]) -> Callable[[Bench], Bench]:
    """For fixture_run.run(wrap=…): error frames at these seconds of simulated time."""

    def wrap(bench: Bench) -> Bench:
        clock = bench.station.clock
        clock.attach(Trouble(bench.station.bus.service(()), clock, list(plan)))  # type: ignore[attr-defined,arg-type]
        return bench

    return wrap
