"""Values as a record keeps them: text that is text, numbers that are numbers, documents as JSON."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import orjson


def text(value: str) -> str:
    """The string with lone surrogates (bytes that were no UTF-8) written as escapes."""
    if type(value) is str and value.isascii():
        return value
    return str(value).encode("utf-8", "backslashreplace").decode()


def number(value: float | None) -> float | None:
    """A float as SQLite gives it back: no NaN, no infinity, no negative zero."""
    return float(value) + 0.0 if value is not None and math.isfinite(value) else None


def document(value: Any) -> str:
    """JSON with sorted keys and every float bit for bit; NaN and infinities become null, bytes hexadecimal."""
    try:
        return orjson.dumps(value, _encode_unknown, _AS_KEPT).decode()
    except TypeError:  # text that is none, keys that are none, a number beyond 64 bits: rare, and worth a second look
        return _JSON.encode(to_plain(value))


def to_plain(value: Any) -> Any:
    """The value as JSON knows it: mappings, arrays, dataclasses and numpy scalars become dict, list, number."""
    if value is None or isinstance(value, bool | np.bool_):
        return None if value is None else bool(value)
    if isinstance(value, str):
        return text(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return _nested(value)


def _nested(value: Any) -> Any:
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value).hex()
    if isinstance(value, Mapping):
        return {text(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return to_plain(value.tolist())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Sequence | set | frozenset):
        return [to_plain(v) for v in value]
    raise TypeError(f"the log cannot keep a {type(value).__name__}")


def _encode_unknown(value: Any) -> Any:
    """What the JSON encoder does not know by itself, as what it knows."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.bool_ | np.integer | np.floating):
        return value.item()
    return _nested(value)


_AS_KEPT = orjson.OPT_SORT_KEYS | orjson.OPT_PASSTHROUGH_DATACLASS | orjson.OPT_PASSTHROUGH_DATETIME
_JSON = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
