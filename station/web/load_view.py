"""Which of the five states the operator's screen is in, and what its one thing to do is: pure, from a few facts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

State = Literal["scan", "ready", "running", "act", "done"]
#: Outcomes that say something of the unit; all others say that it was not measured.
DECIDED = ("PASS", "FAIL")


@dataclass(frozen=True, slots=True)
class Facts:
    """What the state hangs on. nests: names in order; waiting: nest → serial of the next load; entries: the units of
    the last load as the run has them; fault: why it ended early; question: a person must confirm something;
    instruction: a person must turn the fixture; cleared, binned: what a person has said about the last load."""

    nests: Sequence[str]
    running: bool = False
    question: bool = False
    instruction: bool = False
    waiting: Mapping[str, str] = field(default_factory=dict)
    entries: Sequence[Mapping[str, Any]] = ()
    fault: bool = False
    cleared: bool = False
    binned: bool = False


@dataclass(frozen=True, slots=True)
class View:
    """state; why: `question`, `turn` or `fault` in `act`; turn: the nest whose unit is scanned next; bin: nests whose
    failed units wait for the red bin; again: nests whose units were not measured."""

    state: State
    why: str = ""
    turn: str = ""
    bin: tuple[str, ...] = ()
    again: tuple[str, ...] = ()

    @property
    def lamp(self) -> str:
        """Colour of the stack light after IEC 60073: red fault, amber look here, blue act, green runs, white waits."""
        if self.state == "act":
            return "red" if self.why == "fault" else "blue"
        if self.state == "done":
            return "amber" if self.bin or self.again else "green"
        return "green" if self.state == "running" else "white"


def view_of(facts: Facts) -> View:
    """The state of the screen."""
    if facts.running:
        why = "question" if facts.question else "turn" if facts.instruction else ""
        return View("act" if why else "running", why)
    failed = tuple(n["nest"] for n in facts.entries if n.get("outcome") == "FAIL")
    again = tuple(n["nest"] for n in facts.entries if n.get("outcome") not in DECIDED)
    if not facts.cleared:
        if failed and not facts.binned:
            return View("done", bin=failed, again=again)
        if facts.fault:
            return View("act", "fault", again=again)
        if facts.entries:
            return View("done", again=again)
    free = next((name for name in facts.nests if name not in facts.waiting), "")
    return View("scan" if free else "ready", turn=free, again=() if facts.waiting else again)
