"""Questions of the audit that people gave a name, in a file beside the log: `station.questions/1`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from station.errors import StoreFault, UsageError
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.messages import system_reason

SCHEMA = "station.questions/1"
#: So many questions, with names and fields of so many characters.
MOST_QUESTIONS, LONGEST = 100, 80


@dataclass(frozen=True, slots=True)
class Questions:
    """The questions of one log. A file that is not whole counts as empty: nothing in it could not be asked anew."""

    path: Path

    def all(self) -> dict[str, dict[str, str]]:
        """Fields of the form by the question's name, in the order of names."""
        try:
            document = read_json(self.path)
            stored = document["questions"] if document["schema"] == SCHEMA else {}
            return {str(name): {str(k): str(v) for k, v in stored[name].items()} for name in sorted(stored)}
        except (OSError, *NOT_AS_EXPECTED):
            return {}

    def save(self, name: str, fields: Mapping[str, str]) -> None:
        """Keeps a question under a name, in the place of one that had it. Errors: UsageError, StoreFault."""
        if not name.isprintable() or not 0 < len(name) <= LONGEST:
            raise UsageError("question-name", limit=LONGEST)
        if not any(fields.values()):
            raise UsageError("question-empty")
        kept = self.all() | {name: {k: v[:LONGEST] for k, v in fields.items() if v}}
        if len(kept) > MOST_QUESTIONS:
            raise UsageError("question-too-many", limit=MOST_QUESTIONS)
        self._write(kept)

    def forget(self, name: str) -> None:
        """Removes a question. Errors: UsageError where there is none, StoreFault."""
        kept = self.all()
        if kept.pop(name, None) is None:
            raise UsageError("question-unknown", name=name[:LONGEST])
        self._write(kept)

    def _write(self, kept: Mapping[str, Mapping[str, str]]) -> None:
        try:
            replace_text(self.path, json.dumps({"schema": SCHEMA, "questions": kept}, ensure_ascii=False, indent=1))
        except OSError as error:
            raise StoreFault("questions-not-kept", file=str(self.path), why=system_reason(error)) from error
