"""Model files (`station.model/1`), read and checked."""

from itertools import islice
from pathlib import Path

from station.config.documents import at_key, load_document, validate
from station.config.validation_messages import MOST_MISTAKES
from station.errors import InputError
from station.model.model_check import model_mistakes
from station.model.model_file import Model

#: A model that has learnt every stop of a fleet is long.
MOST_BYTES = 25_000_000


def load_model(path: Path | None, unit: str | None = None) -> Model:
    """The model in a file; the plain one when there is none. unit: of the recipe that it is for, where there is one.
    Errors: InputError with every mistake and its line."""
    if path is None:
        return Model()
    document = load_document(path, InputError, MOST_BYTES)
    model = validate(document, Model, InputError)
    if wrong := list(islice(model_mistakes(model, unit), MOST_MISTAKES)):
        raise InputError("document-mistakes", file=str(path), mistakes=[at_key(document, *one) for one in wrong])
    return model
