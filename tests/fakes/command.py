"""A command of the station in the test's own process: what a start of Python costs is not what is tried."""

import contextlib
import io
from typing import NamedTuple

from station.cli import app


class Done(NamedTuple):
    """A command that has ended, by the names of subprocess."""

    returncode: int
    stdout: str
    stderr: str


def station(*words: object) -> int:
    """The exit code of `station WORDS…`; what it prints goes where the test's output goes."""
    try:
        app.main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)
    raise AssertionError(f"station {words} came back without an exit code")


def captured(*words: object) -> Done:
    """`station WORDS…` with what it prints on both streams."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = station(*words)
    return Done(code, out.getvalue(), err.getvalue())
