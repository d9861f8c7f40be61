"""A reader's language, as what is drawn and certified needs it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from station.messages import Message, labels, render
from station.messages.message import TEXT


@dataclass(frozen=True, slots=True)
class Words:
    """code: the language; texts: its labels by key; say: a sentence of the station in it."""

    code: str
    texts: Mapping[str, str]
    say: Callable[[str], str]

    def render(self, message: Message) -> str:
        """A message in this language; what an older log kept as a sentence, as `say` has it."""
        text = render(message, self.code)
        return self.say(text) if message.id == TEXT else text


def words_of(code: str, say: Callable[[str], str] = str) -> Words:
    """Words of that language."""
    return Words(code, labels.all_texts()[code], say)
