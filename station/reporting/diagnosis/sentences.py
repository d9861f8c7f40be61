"""The report's sentences, from the catalogue."""

from station.messages import Message, Value, render


def report_text(id: str, /, **values: Value) -> str:  # noqa: A002 - the word of the format
    """A sentence of the report in English."""
    return render(Message(id, **values))
