"""A reader's language, as what is drawn and certified needs it."""

from collections.abc import Mapping
from dataclasses import dataclass

from station.errors import UsageError
from station.messages import Message, labels, render, templates, term, term_id


@dataclass(frozen=True, slots=True)
class Words:
    """code: the language; texts: its labels by key."""

    code: str
    texts: Mapping[str, str]

    def render(self, message: Message) -> str:
        """A message in this language; what an older log holds as a sentence, as it stands there."""
        return render(message, self.code)

    def term(self, name: str) -> str:
        """The name of a quantity, chart or column in this language; a name without an entry `term-…` as it is."""
        return term(name, self.code)


def term_message(name: str) -> Message:
    """The same as a message, to stand in another."""
    return Message(term_id(name)) if term_id(name) in templates("en") else Message.text(name)


def words_of(code: str) -> Words:
    """Words of that language. Errors: UsageError where there is none of that code."""
    known = labels.all_texts()
    if code not in known:
        raise UsageError("language-unknown", given=code[:20], known=tuple(known))
    return Words(code, known[code])
