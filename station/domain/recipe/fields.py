"""Field types and the base class that every block of the documents uses."""

from collections.abc import Callable, Sequence
from datetime import date
from difflib import get_close_matches
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from station.errors import InvalidValue

#: No quantity of a bench, a unit or a process is larger, and none but 0 smaller, in whatever unit; their squares are
#: still numbers.
LARGEST, SMALLEST = 1e15, 1e-30
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]


def _not_a_switch(value: Any) -> Any:
    if isinstance(value, bool):
        raise InvalidValue("value-not-number", given=str(value).lower())
    return value


#: The same where `true` is no 1.
Number = Annotated[float, BeforeValidator(_not_a_switch), Field(allow_inf_nan=False)]


Vector = tuple[Finite, Finite, Finite]


def _not_as_good_as_nothing(value: float) -> float:
    if 0 < value < SMALLEST:
        raise InvalidValue("value-below", limit=SMALLEST, given=value)
    return value


Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False), AfterValidator(_not_as_good_as_nothing)]

#: How much warmer or colder a run is, degC: beyond this no sensor works.
TemperatureStep = Annotated[float, Field(ge=-300, le=300, allow_inf_nan=False)]

#: Standard deviation of an angle: beyond this a direction is not known at all.
AngleStd = Annotated[float, Field(ge=0, le=45, allow_inf_nan=False)]


NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False), AfterValidator(_not_as_good_as_nothing)]


Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[\w.+\-/ ]+$")]


def _check_day(text: str) -> str:
    try:
        written = date.fromisoformat(text).isoformat()
    except ValueError:
        written = ""
    if written != text:
        raise InvalidValue("day-unknown", given=text)
    return text


#: A day that exists, as ISO 8601 writes it.
Day = Annotated[str, Field(json_schema_extra={"pattern": r"^\d{4}-\d\d-\d\d$"}), AfterValidator(_check_day)]


class StrictModel(BaseModel):
    """Base of every block: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


def one_of(known: Callable[[], Sequence[str]]) -> BeforeValidator:
    """Checks that a value is one of the names that exist, plug-ins by their files."""

    def check(value: Any) -> Any:
        names = known()
        if value not in names:
            near = get_close_matches(str(value), names, 1, 0)[0]
            raise InvalidValue("name-unknown", given=str(value), known=tuple(names), nearest=near)
        return value

    return BeforeValidator(check)
