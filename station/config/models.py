"""Model files (`station.model/1`), read and checked."""

from pathlib import Path

from station.config.documents import load_document, validate
from station.errors import InputError
from station.model.model_file import Model

#: A model that has learnt every stop of a fleet is long.
MOST_BYTES = 25_000_000


def load_model(path: Path | None) -> Model:
    """The model in a file; the plain one when there is none. Errors: InputError with every mistake and its line."""
    if path is None:
        return Model()
    return validate(load_document(path, InputError, MOST_BYTES), Model, InputError)
