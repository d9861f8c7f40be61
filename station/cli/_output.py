"""What every command's face shares: JSON on standard output, people's text and progress on standard error."""

import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from station.cli._layout import TextTable, command_lines, printable_text, sentence_lines
from station.messages import Message, render

if TYPE_CHECKING:
    from rich.progress import Progress

#: Colours of a terminal by their names.
_ANSI = {"red": 31, "green": 32, "yellow": 33, "magenta": 35}
#: Lines are made no shorter than this, whatever a screen or COLUMNS says.
_NARROWEST = 20
NO_COLOURS: Mapping[str, str] = MappingProxyType({})
#: What every command takes, and the variable of the environment that stands for it.
FLAGS = {"--quiet": "STATION_QUIET", "--no-progress": "STATION_NO_PROGRESS"}


def on_terminal() -> bool:
    """Whether a person watches: progress shows only then."""
    if any(os.environ.get(variable) for variable in FLAGS.values()):
        return False
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def screen_width() -> int:
    """How many characters a line on the screen may have."""
    return max(_NARROWEST, shutil.get_terminal_size().columns)


def line_width() -> int | None:
    """How many characters a line on standard output may have; None in a pipe, unless COLUMNS says so."""
    if sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit():
        return screen_width()
    return None


def read_password(name: str) -> str:
    """The password of a person: asked for, or the next line of standard input in a pipe."""
    if sys.stdin.isatty():
        import getpass

        return getpass.getpass(f"password of {name}: ")
    return sys.stdin.readline(1000).rstrip("\r\n")


def print_raw(text: str = "") -> None:
    """A text for a program on standard output, as it is; a reader that has gone is no reason to stop."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_line(text: str = "") -> None:
    """Lines for a person on standard output: broken between words where the screen ends."""
    for line in text.split("\n"):
        for part in sentence_lines(printable_text(line), line_width()):
            print_raw(part)


def print_command(text: str) -> None:
    """A command to paste, on standard output."""
    for line in command_lines(printable_text(text), line_width()):
        print_raw(line)


def print_message(message: Message) -> None:
    """A message's sentence on standard output."""
    print_line(render(message))


def print_table(title: str, table: TextTable, colours: Mapping[str, str] = NO_COLOURS) -> None:
    """A table for a person. colours: words and the colour of each, on a terminal that shows them."""
    if title:
        print_line(title)
    shown = colours if sys.stdout.isatty() and not os.environ.get("NO_COLOR") else NO_COLOURS
    for line in table.lines(line_width()):
        text = printable_text(line)
        for word, colour in shown.items():
            text = text.replace(word, f"\x1b[{_ANSI[colour]}m{word}\x1b[0m")
        print_raw(text)


def print_remark(text: str) -> None:
    """One line for the person, on standard error."""
    if not os.environ.get(FLAGS["--quiet"]):
        print_person(text)


def print_person(text: str) -> None:
    """A sentence on standard error; one line in a pipe, broken between words on a terminal."""
    width = screen_width() if sys.stderr.isatty() else None
    for line in sentence_lines(printable_text(text), width):
        print(line, file=sys.stderr, flush=True)


def print_json(document: Any) -> None:
    """The one JSON document of a command with `--json`; in ASCII alone where the output takes no other letters."""
    ascii_only = (getattr(sys.stdout, "encoding", None) or "utf-8").lower().replace("-", "") != "utf8"
    print_raw(json.dumps(document, allow_nan=False, ensure_ascii=ascii_only))


@contextmanager
def progress() -> Iterator["Progress"]:
    """A progress bar on a terminal; the same object, silent, in a pipe. Field `until_s` of a task: a countdown to that
    instant of the monotonic clock stands behind it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Countdown(ProgressColumn):
        """What is left of a wait whose length is known."""

        def render(self, task: Task) -> Text:
            until_s = task.fields.get("until_s")
            return Text("" if until_s is None else countdown(until_s - time.monotonic()))

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        Countdown(),
    )
    with Progress(*columns, console=Console(stderr=True, highlight=False), disable=not on_terminal()) as bar:
        yield bar


def countdown(left_s: float) -> str:
    """Minutes and seconds that are left."""
    minutes, seconds = divmod(max(0, round(left_s)), 60)
    return f"{minutes}:{seconds:02d} left"


@contextmanager
def activity(what: Message) -> Iterator[Callable[[Message], None]]:
    """What the command is doing and for how long, on a terminal, where nobody can say how much is left; gone when it is
    done. Gives a function that names the next step."""
    if not on_terminal():
        yield lambda _step: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    screen = Console(stderr=True, highlight=False)
    with Progress(*columns, console=screen, transient=True) as shown:
        task = shown.add_task(render(what), total=None)
        yield lambda step: shown.update(task, description=render(step))
