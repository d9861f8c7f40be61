"""The samples of a diagnosis: of a table, a recorded CAN log or the station's log; of a large table in portions."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path

import numpy as np

from station.cli import _output
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import LogError, SamplesError, UsageError
from station.messages import Message, render

#: Endings of recorded CAN logs, as `station replay` reads them.
CAN_LOGS = (".log", ".blf", ".asc", ".mf4")
#: A thousand units of three runs of 24 visits are 7.2 million; every row costs some 300 bytes of memory.
MOST_ROWS = 10_000_000
#: A table of more rows is gone through in portions of about so many.
LARGE_ROWS, PORTION_ROWS = 500_000, 100_000


@dataclass(frozen=True, slots=True)
class MeasuredSource:
    """Where samples come from: a file, or a log and the time from which on; and the recipe that they were taken by."""

    samples: Path | None
    db: Path | None
    since: str | None
    recipe_name: str
    recipe: Recipe

    def table(self) -> SampleTable:
        """All samples. Errors: InputError."""
        return _table(self.samples, self.db, self.since, self.recipe_name, self.recipe)

    def portions(self) -> Callable[[], Iterator[SampleTable]] | None:
        """A large table in portions of whole units, a new pass at each call; None of any other. SamplesError."""
        from station.wiring.sample_files import portions_of_units, rows_about

        path = self.samples
        if path is None or self.db is not None or self.since is not None or path.suffix.lower() in CAN_LOGS:
            return None
        if not LARGE_ROWS < rows_about(path) <= MOST_ROWS:
            return None
        return partial(portions_of_units, path, PORTION_ROWS)


def _table(samples: Path | None, db: Path | None, since: str | None, recipe_name: str, recipe: Recipe) -> SampleTable:
    """The samples of a table, of a recorded CAN log, or of the station's log."""
    if (samples is None) == (db is None):
        raise UsageError("diagnose-without-samples")
    if since is not None and db is None:
        raise UsageError("diagnose-since-needs-db")
    if samples is None:
        return _table_of_store(db, since, recipe)
    if samples.suffix.lower() in CAN_LOGS:
        return _table_of_recording(samples, recipe_name)
    from station.wiring.sample_files import read_samples, rows_about

    rows = rows_about(samples)
    if rows > MOST_ROWS:
        raise SamplesError("diagnose-too-many-rows", file=str(samples), rows=rows, limit=MOST_ROWS)
    table = read_samples(samples)
    _check_names(table, recipe, samples)
    return table


def _check_names(table: SampleTable, recipe: Recipe, path: Path) -> None:
    """Errors: SamplesError with the line of the first position or seating that the recipe does not know."""
    from station.wiring.sample_files import PieceOrigin

    seating = table.labels.get("seating")
    columns = [("seating", seating, ["home", *recipe.seatings])] if seating is not None else []
    if recipe.pose_known:
        columns.append(("position", table.position, [p.name for p in recipe.positions]))
    for column, labels, names in columns:
        strange = [i for i, name in enumerate(labels.names) if name not in names]
        rows = np.flatnonzero(np.isin(labels.code, strange))
        if len(rows):
            name = labels.names[labels.code[rows[0]]]
            near = get_close_matches(name, names, 1, 0)[0]
            place = PieceOrigin(path, 0).of(int(rows[0]))
            raise SamplesError(
                "samples-name-unknown", place=place, column=column, name=name, recipe=recipe.name, nearest=near
            )


def _table_of_recording(log: Path, recipe_name: str) -> SampleTable:
    """All samples of a recorded CAN log, by the marks beside it."""
    from station.cli._replay import open_recording
    from station.service.replay import tables
    from station.wiring.sample_files import join

    job, frames, marks = open_recording(log, recipe_name, None)
    return join(list(tables(frames, marks, job)))


def _table_of_store(db: Path | None, since: str | None, recipe: Recipe) -> SampleTable:
    """All samples of this recipe in the log."""
    from station.cli._log_options import open_named_log, parse_time_ns
    from station.ports.log_reader import Query
    from station.service import stored_attempts as stored
    from station.wiring.sample_files import join

    with open_named_log(db, None) as log:
        query = Query(recipe_name=recipe.name, since_ns=parse_time_ns(since, "--since"))
        attempts = log.attempts(query)[::-1]
        tables = list(stored.samples(log, attempts))
        if not tables:
            raise LogError("log-no-visits-of-recipe", log=log.location, recipe=recipe.name)
        return join(tables)


def without_gaps(table: SampleTable) -> SampleTable:
    """The table without optional columns that have gaps: a cause cannot be laid to what is not always known."""
    gaps = [name for name, values in table.values.items() if not np.all(np.isfinite(values))]
    if gaps:
        remark = render(Message("covariates-with-gaps", columns=tuple(gaps)))
        _output.print_remark(f"station: {remark}")
    return replace(table, values={name: v for name, v in table.values.items() if name not in gaps})
