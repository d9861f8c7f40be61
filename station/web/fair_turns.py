"""One thing at a time for many who wait: each in turn, however many tries one of them has waiting."""

from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from anyio import Event, get_cancelled_exc_class


@dataclass(slots=True)
class FairTurns:
    """Turns by whoever waits (an address): whoever is alone waits for one turn of each other at most.

    most_waiting: so many of one may wait; what comes beyond is not taken in.
    """

    most_waiting: int = 32
    _busy: bool = False
    _waiting: dict[str, deque[Event]] = field(default_factory=dict)  # in the order of the next turns

    def full(self, who: str) -> bool:
        """Whether there is no room for one more of this one."""
        return len(self._waiting.get(who, ())) >= self.most_waiting

    @asynccontextmanager
    async def turn(self, who: str) -> AsyncIterator[None]:
        """Waits for the turn, and has it inside."""
        if self._busy:
            await self._wait(who)
        self._busy = True
        try:
            yield
        finally:
            self._pass_on()

    async def _wait(self, who: str) -> None:
        mine = Event()
        self._waiting.setdefault(who, deque()).append(mine)
        try:
            await mine.wait()
        except get_cancelled_exc_class():
            if mine.is_set():
                self._pass_on()
            else:
                self._remove(who, mine)
            raise

    def _pass_on(self) -> None:
        """Gives the turn to who waits first; whoever has more waiting comes after all others again."""
        self._busy = bool(self._waiting)  # nobody comes in between
        if self._waiting:
            who = next(iter(self._waiting))
            tries = self._waiting.pop(who)
            tries.popleft().set()
            if tries:
                self._waiting[who] = tries

    def _remove(self, who: str, gone: Event) -> None:
        tries = self._waiting[who]
        tries.remove(gone)
        if not tries:
            del self._waiting[who]
