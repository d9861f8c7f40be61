"""What every command's face shares: JSON on standard output, people's text and progress on standard error."""

import json
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from station.messages import Message, render

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

#: As wide as a line of a table may be in a pipe or a file.
PIPE_WIDTH = 160
#: A screen narrower than this gets one blank between columns instead of two.
ROOMY_WIDTH = 90


#: What every command takes, and the variable of the environment that stands for it.
FLAGS = {"--quiet": "STATION_QUIET", "--no-progress": "STATION_NO_PROGRESS"}


def on_terminal() -> bool:
    """Whether a person watches: progress shows only then."""
    if any(os.environ.get(variable) for variable in FLAGS.values()):
        return False
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def console(stderr: bool = False) -> "Console":
    """A console for tables (standard output) or for people's remarks (standard error)."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    # A pipe has no width: lines stay whole there.
    return Console(stderr=stderr, highlight=False, width=None if stream.isatty() else PIPE_WIDTH)


def line_width() -> int | None:
    """How many characters a line of text may have; None where nobody looks at it on a screen."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def table_style() -> dict[str, Any]:
    """How a table is drawn: without lines, and close together on a screen of 80 columns."""
    from rich.box import SIMPLE_HEAD

    narrow = (line_width() or PIPE_WIDTH) < ROOMY_WIDTH
    return {"box": SIMPLE_HEAD, "pad_edge": False, "show_edge": False, "padding": (0, 0) if narrow else (0, 1, 0, 0)}


def read_password(name: str) -> str:
    """The password of a person: asked for, or the next line of standard input in a pipe."""
    if sys.stdin.isatty():
        import getpass

        return getpass.getpass(f"password of {name}: ")
    return sys.stdin.readline(1000).rstrip("\r\n")


def print_line(text: str = "") -> None:
    """One line on standard output; a reader that has gone is no reason to stop."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_message(message: Message) -> None:
    """A message as one line of its sentence on standard output, with nothing in it that could steer the terminal."""
    print_line("".join(c if c.isprintable() else " " for c in render(message)))


def print_remark(text: str) -> None:
    """One line for the person, on standard error, with nothing in it that could steer the terminal."""
    if os.environ.get(FLAGS["--quiet"]):
        return
    print("".join(c if c.isprintable() else " " for c in text), file=sys.stderr, flush=True)


def print_json(document: Any) -> None:
    """The one JSON document of a command with `--json`."""
    print_line(json.dumps(document, allow_nan=False, ensure_ascii=False))


@contextmanager
def progress() -> Iterator["Progress"]:
    """A progress bar on a terminal; the same object, silent, in a pipe."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console(stderr=True), disable=not on_terminal()) as bar:
        yield bar
