"""Tables of a certificate and the words that head them."""

from collections.abc import Sequence
from dataclasses import dataclass

from station.messages import Message, templates
from station.reporting.words import Words

Rows = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class CertificateTable:
    """A titled table; one without heads has a label in front of each row."""

    title: str
    columns: tuple[str, ...]
    rows: Rows


class SectionWriter:
    """Words of one language."""

    def __init__(self, words: Words) -> None:
        self.texts, self.term, self.render = words.texts, words.term, words.render

    def __call__(self, key: str, *values: str) -> str:
        """The text `cert_KEY`, with its values."""
        return self.texts[f"cert_{key}"].format(*values)

    def say(self, message: str, **values: str) -> str:
        """The message of that id."""
        return self.render(Message(message, **values))

    def table(self, title: str, columns: Sequence[str], rows: Rows) -> CertificateTable:
        """A table whose title and heads stand in the catalogues; a head that does not is shown as it is."""
        known = templates("en")
        heads = [self.say(f"head-{c}") if f"head-{c}" in known else self.term(c) for c in columns]
        return CertificateTable(self.say(title), tuple(heads), rows if heads else _labelled(rows))

    def section(self, title: str, columns: Sequence[str], rows: Rows) -> CertificateTable:
        """A table whose title is the text `TITLE`, with its heads as they are."""
        return CertificateTable(self.texts[title], tuple(columns), rows if columns else _labelled(rows))


def _labelled(rows: Rows) -> Rows:
    """Labels begin with a capital."""
    return tuple((label[:1].upper() + label[1:], *values) for label, *values in rows)
