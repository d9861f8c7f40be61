"""Stored visits of many units at once: units of a fleet differ in their numbers alone, and a column of numbers is read
faster than the lists of unit after unit."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from station.domain.core.types import Floats, ReducedVisits
from station.domain.evaluation.reduced_visits_document import TEXT, at_recipe, from_document, stored_values
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.references import Truths
from station.errors import LogError

#: Units read together: enough to be fast, few enough for a processor's cache.
BATCH = 128
#: What numbers are written with, and what stands around them.
_OF_NUMBERS, _AROUND_NUMBERS = b"0123456789.eE+-", b"[]{}: \n"
#: Text between two strings that holds numbers is longer than that: `:[`, `,`, `], ` hold none.
_NO_NUMBERS = 3

#: Every string of a text, and the rest of it without its numbers: texts with the same differ in numbers alone.
_Form = tuple[tuple[str, ...], bytes]


def from_texts(texts: Sequence[str], recipe: Recipe, truths: Truths) -> Iterator[ReducedVisits]:
    """The visits of each text, bit for bit as `from_document` makes them of one. Errors: LogError."""
    for first in range(0, len(texts), BATCH):
        batch = texts[first : first + BATCH]
        same: dict[_Form, list[tuple[int, bytes]]] = {}
        for i, text in enumerate(batch):
            form, numbers = _split(text)
            same.setdefault(form, []).append((i, numbers))
        found: dict[int, ReducedVisits] = {}
        for members in same.values():
            own, numbers_of = zip(*members, strict=True)
            found.update(zip(own, _of_one_form([batch[i] for i in own], numbers_of, recipe, truths), strict=True))
        yield from (found[i] for i in range(len(batch)))


def _split(text: str) -> tuple[_Form, bytes]:
    """A text's form, and its numbers with commas between them."""
    if "\\" in text:  # a quotation mark may be within a string: such a text goes by itself
        return ((text,), b""), b""
    pieces = text.split('"')
    between = '"'.join(pieces[::2]).encode()
    numbers = "".join(piece for piece in pieces[::2] if len(piece) > _NO_NUMBERS).encode()
    form = tuple(pieces[1::2]), between.translate(None, _OF_NUMBERS)
    return form, numbers.translate(None, _AROUND_NUMBERS).rstrip(b",")


def _of_one_form(
    texts: Sequence[str], numbers: Sequence[bytes], recipe: Recipe, truths: Truths
) -> Iterator[ReducedVisits]:
    document = _parsed(texts[0])
    template, rows = stored_values(document), _floats(numbers)
    order = [name for name in document if name in template and name not in TEXT]
    if rows is None or rows.shape[1] != sum(template[name].size for name in order):
        yield from (from_document(_parsed(text), recipe, truths) for text in texts)
        return
    columns, first = {}, 0
    for name in order:
        one = template[name]
        columns[name] = rows[:, first : first + one.size].reshape(len(texts), *one.shape).astype(one.dtype)
        first += one.size
    names = {name: template[name] for name in TEXT}
    for u in range(len(texts)):
        yield at_recipe(names | {name: column[u] for name, column in columns.items()}, recipe, truths)


def _floats(numbers: Sequence[bytes]) -> Floats | None:
    """The numbers (u, n) of each text, null as NaN; None where they are not as many in each, or no numbers."""
    import pyarrow as pa
    from pyarrow import compute

    joined = b"".join(part + b"," for part in numbers).replace(b"null", b"nan")
    commas = np.flatnonzero(np.frombuffer(joined, np.uint8) == ord(","))
    begins = np.zeros(len(commas) + 1, np.int32)
    begins[1:] = commas - np.arange(len(commas))
    digits = pa.py_buffer(joined.translate(None, b","))
    cells = pa.StringArray.from_buffers(len(commas), pa.py_buffer(begins), digits)
    try:
        return np.asarray(compute.cast(cells, pa.float64())).reshape(len(numbers), -1)
    except ValueError:
        return None


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise LogError("reduced-visits-damaged", why=str(error)) from error
