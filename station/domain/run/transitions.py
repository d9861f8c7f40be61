"""A literal table of what may follow what: the phases of a run, the states of a unit in it."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

from station.errors import StationFault

S = TypeVar("S", bound=StrEnum)


@dataclass(frozen=True, slots=True)
class TransitionTable(Generic[S]):
    """name: what goes through the states, for people; after: each state with those that may follow it."""

    name: str
    after: Mapping[S, frozenset[S]]

    def follow(self, present: S, wanted: S) -> S:
        """`wanted`, when the table lets it follow `present`; StationFault otherwise."""
        if wanted not in self.after[present]:
            raise StationFault("transition-illegal", what=self.name, present=present.value, wanted=wanted.value)
        return wanted

    def diagram(self) -> str:
        """The table as a Mermaid state diagram, states in the order of their enumeration."""
        states = list(self.after)
        lines = [f"    {_name(a)} --> {_name(b)}" for a in states for b in states if b in self.after[a]]
        last = [f"    {_name(a)} --> [*]" for a in states if not self.after[a]]
        return "\n".join(["stateDiagram-v2", f"    [*] --> {_name(states[0])}", *lines, *last])


def _name(state: StrEnum) -> str:
    """A name that Mermaid takes."""
    return state.value.replace("-", "_")
