"""A fleet computed in portions: where its units are read, what computes them, where the results are kept."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Literal, NamedTuple, Protocol, Self

from station.ports.log_reader import Query, ReducedAttempt, SelectedAttempt
from station.ports.store import LogHead

#: What a column of a result holds; `texts`, `numbers`, `integers`: a list of them in each row.
ColumnType = Literal["text", "texts", "number", "numbers", "integer", "integers"]
#: Columns of one portion's result: name → one value a row.
Columns = Mapping[str, Sequence[Any]]


class UnitSource(Protocol):
    """A log, a plant or tables of a fleet, opened for reading. Errors: LogError."""

    @property
    def location(self) -> str:
        """Where it lies, as sentences name it."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None, /
    ) -> None: ...

    def head(self) -> LogHead:
        """The newest record of the log that the units come from."""

    def selection(self, query: Query) -> Iterator[SelectedAttempt]:
        """Attempts that the query names and that have ended, one at a time, in the order of their numbers."""

    def reduced(self, numbers: Sequence[int]) -> list[ReducedAttempt]:
        """Those of the attempts that came to a calibration, in the order of their numbers."""

    def document(self, number: int) -> str:
        """The text of a document that `reduced` names."""

    def recipes(self, query: Query) -> list[str]:
        """The JSON of every recipe that the attempts were made with; "" where none was kept."""


class Portion(NamedTuple):
    """One piece of work. key: the same for the same work by the same code; work: what computes it takes, pickled."""

    key: str
    work: Any


class PortionEngine(Protocol):
    """Computes portions wherever it can. Errors: StationFault, InputError, and those of what computes."""

    def compute(self, function: Callable[[Any], Columns], portions: Iterable[Portion]) -> Iterator[tuple[str, Columns]]:
        """Key and result of each portion, in whatever order they come."""


class PortionResults(Protocol):
    """Results of portions by their keys, kept until somebody deletes them. Errors: StoreFault."""

    def has(self, key: str) -> bool:
        """Whether the portion's result is there."""

    def write(self, key: str, columns: Columns) -> None:
        """Keeps a result: whole and durable when this returns."""

    def read(self, key: str) -> Columns:
        """A result that is there."""

    def retain(self, keys: Sequence[str]) -> None:
        """Deletes what belongs to no portion any more."""
