"""Every error that pydantic can report becomes a message of ours: nothing of its internals reaches a person."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import core_schema

import station
from station.config.pydantic_errors import TYPES
from station.config.validation_messages import mistakes
from station.errors import InvalidValue
from station.messages import languages, render, templates

#: Handled apart: they carry a reason of ours, or the keys that would be right.
APART = {"extra_forbidden", "value_error", "assertion_error"}


def test_every_type_of_error_has_a_message() -> None:
    assert TYPES.keys() | APART >= set(get_args(core_schema.ErrorType))
    assert {id_ for id_, _ in TYPES.values()} <= templates("en").keys()


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    axis: Literal["x", "y"] = "x"


class Everything(BaseModel):
    model_config = ConfigDict(extra="forbid")
    count: Annotated[int, Field(ge=1, le=9)] = 1
    size: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    name: Annotated[str, Field(max_length=3, pattern="^[a-z]*$")] = ""
    names: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)] = ("a",)
    pair: tuple[float, float] = (0.0, 0.0)
    on: bool = True
    inner: Inner = Inner()
    by_name: dict[str, Inner] = Field(default_factory=dict)
    nest: str = "A"

    @field_validator("nest")
    @classmethod
    def _known(cls, value: str) -> str:
        if value != "A":
            raise InvalidValue("nest-name-twice", name=value)
        return value


def sentences(data: Any, language: str = "en") -> list[str]:
    with pytest.raises(ValidationError) as caught:
        Everything.model_validate(data)
    return [render(m, language) for m in mistakes(caught.value, Everything)]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"count": "many"}, "key `count`: must be a whole number, not 'many'"),
        ({"count": 1.5}, "key `count`: must be a whole number, not 1.5"),
        ({"count": 0}, "key `count`: must be at least 1, not 0"),
        ({"count": 10}, "key `count`: must be at most 9, not 10"),
        ({"count": None}, "key `count`: must be a whole number, not nothing"),
        ({"size": 0}, "key `size`: must be greater than 0, not 0"),
        ({"size": float("nan")}, "key `size`: must be a finite number, not nan"),
        ({"name": "abcd"}, "key `name`: takes at most 3 characters, not 'abcd'"),
        ({"name": "aB!"}, "key `name`: may not contain 'B', '!', as 'aB!' does"),
        ({"names": []}, "key `names`: needs at least 1 entry, has 0: []"),
        ({"names": ["a", "b", "c"]}, "key `names`: takes at most 2 entries, has 3: ['a', 'b', 'c']"),
        ({"names": 5}, "key `names`: must be a list, not 5"),
        ({"pair": [1]}, "key `pair.1`: is missing; add it"),
        ({"on": "perhaps"}, "key `on`: must be true or false, not 'perhaps'"),
        ({"inner": 3}, "key `inner`: must be a block of keys, not 3"),
        ({"inner": {"axis": "z"}}, "key `inner.axis`: must be one of 'x', 'y', not 'z'"),
        ({"by_name": {"a": {"axes": 1}}}, "key `by_name.a.axes`: unknown key; did you mean `axis`?"),
        ({"inner": {"qqqq": 1}}, "key `inner.qqqq`: unknown key; the known keys are axis"),
        ({"nest": "B"}, "key `nest`: nest B is listed twice; nest names must differ"),
        ([1], "must be a block of keys, not [1]"),
    ],
)  # fmt: skip
def test_the_sentence_of_a_mistake(data: Any, sentence: str) -> None:
    assert sentences(data) == [sentence]


@pytest.mark.parametrize("language", languages())
def test_no_english_of_pydantic_in_any_language(language: str) -> None:
    wrong = {"count": "a", "size": "b", "names": [], "pair": [1, 2, 3], "on": 7, "inner": [], "nest": "B", "zz": 0}
    for sentence in sentences(wrong, language):
        assert not any(word in sentence for word in ("Input", "should", "after validation", "pydantic", "tuple"))


def test_a_reason_ends_without_a_full_stop() -> None:
    """The sentence that lists the mistakes of a file has its own; formulas are refused one at a time, as sentences."""
    used = {
        found
        for file in Path(station.__file__).parent.rglob("*.py")
        for found in re.findall(r'InvalidValue\(\s*"([a-z0-9-]+)"', file.read_text(encoding="utf-8"))
        if not found.startswith("formula-")
    }
    assert len(used) > 50
    for code in languages():
        texts = templates(code)
        assert [id_ for id_ in sorted(used) if re.search(r"[^.][.。]$", texts[id_])] == []
