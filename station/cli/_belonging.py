"""Which options of a command belong to which of its actions, as its module says in two tables.

`GOES_WITH`: an option → words one of which must stand beside it. `APART`: an option → words none of which may.
"""

from collections.abc import Mapping, Sequence
from types import ModuleType

from station.errors import UsageError
from station.messages import Message

Table = Mapping[str, tuple[str, ...]]


def check_belonging(command: str, module: ModuleType, args: Sequence[str]) -> None:
    """Errors: UsageError for an option that this call would not read."""
    words = {word.partition("=")[0] for word in args}
    goes_with: Table = getattr(module, "GOES_WITH", {})
    apart: Table = getattr(module, "APART", {})
    for option, partners in goes_with.items():
        if option in words and not words & {*partners}:
            raise _refusal(command, option, Message("option-goes-with", partners=" / ".join(partners)))
    for option, others in apart.items():
        if option in words and (met := [other for other in others if other in words]):
            raise _refusal(command, option, Message("option-not-with", partners=" / ".join(met)))


def _refusal(command: str, option: str, reason: Message) -> UsageError:
    return UsageError("command-line-wrong", command=command, why=Message("option-wrong", option=option, reason=reason))
