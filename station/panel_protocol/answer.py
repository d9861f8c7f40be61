"""The page's answer to a run's question: the mark of the question comes back once somebody has confirmed it."""

import json
from pathlib import Path

from station.files.json_text import read_json
from station.files.replace import replace_text
from station.panel_protocol.companion import Companion, companion_file

SCHEMA = "station.answer/1"


def write_answer(database: Path, mark: str) -> None:
    """Confirms the question that bears this mark. Errors: OSError."""
    replace_text(companion_file(database, Companion.ANSWER), json.dumps({"schema": SCHEMA, "question": mark}))


def read_answer(database: Path) -> str:
    """The mark of the last question that was confirmed, or ''."""
    try:
        return str(read_json(companion_file(database, Companion.ANSWER))["question"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""
