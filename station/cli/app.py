"""`station`: finds the commands by file name, runs one, and turns every error into a sentence and an exit code."""

import ast
import difflib
import errno
import functools
import gc
import importlib
import io
import keyword
import math
import os
import signal
import sys
import textwrap
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import station
from station.cli import _output
from station.errors import Aborted, StationError, StationFault, UsageError
from station.messages import Message, render, system_reason

_FOLDER = Path(__file__).parent

#: A start makes a hundred thousand objects that stay: looking for garbage after every 700 takes a tenth of its time.
_GC_THRESHOLDS = (50_000, 20, 100)
#: Matrices are some hundred rows at most: a second thread of the linear algebra would only wait, and burn a processor
#: as it does. Read where numpy is loaded; what the user has set stands.
_LINEAR_ALGEBRA_THREADS = ("OPENBLAS_NUM_THREADS", "1")
#: What typer answers to Ctrl-C, and the exit codes of docs/formats.md.
_OUTPUT_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
#: So much of a name that is too long is shown.
_LONGEST_NAME = 60
_INTERRUPTED, _ABORTED_CODE, _BUG_CODE, _NOBODY_READS_CODE = 130, 4, 70, 3


def main(args: Sequence[str] | None = None) -> None:
    """The entry point: the one place that catches. Exit codes: docs/formats.md."""
    gc.set_threshold(*_GC_THRESHOLDS)
    os.environ.setdefault(*_LINEAR_ALGEBRA_THREADS)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _raise_interrupt)
    _open_standard_streams()
    sys.exit(_guarded(list(sys.argv[1:] if args is None else args)))


def commands() -> dict[str, str]:
    """Every command and the first line of its help, read without importing any."""
    return {name: _first_line(path) for name, path in _modules().items()}


def _modules() -> dict[str, Path]:
    """The file of each command: all of this folder but this one and those whose names begin with an underscore."""
    files = sorted(path for path in _FOLDER.glob("[!_]*.py") if path != Path(__file__))
    return {path.stem.rstrip("_").replace("_", "-"): path for path in files}


def _first_line(path: Path) -> str:
    body = ast.parse(path.read_text(encoding="utf-8")).body
    (function,) = (node for node in body if isinstance(node, ast.FunctionDef) and node.name == "command")
    return (ast.get_docstring(function) or "").partition("\n")[0]


def _guarded(args: list[str]) -> int:
    try:
        code = run_command(args)
        sys.stdout.flush()
    except StationError as exc:
        return _fail(exc.sentence, exc.exit_code)
    except KeyboardInterrupt:
        return _fail(render(Message("stopped-by-operator")), _ABORTED_CODE)
    except BrokenPipeError:
        _discard_output()
        return _NOBODY_READS_CODE
    except Exception as exc:  # noqa: BLE001 - the last face: a bug becomes a sentence and a file
        return _fail(*_unexpected(exc, args))
    return code


def _unexpected(exc: Exception, args: list[str]) -> tuple[str, int]:
    """Sentence and exit code of what no face expects: the machine has run out of something, or a bug."""
    if isinstance(exc, MemoryError):
        return render(Message("out-of-memory")), StationFault.exit_code
    if isinstance(exc, OSError) and exc.errno == errno.ENAMETOOLONG:  # a path of the command line, wherever it is read
        name = f"{str(exc.filename)[:_LONGEST_NAME]}…"
        return render(Message("file-unreadable", file=name, why=system_reason(exc))), UsageError.exit_code
    if isinstance(exc, OSError) and exc.errno in _OUTPUT_ERRORS:
        _discard_output()
        return render(Message("output-not-written", reason=system_reason(exc))), StationFault.exit_code
    return _write_crash_report(exc, args), _BUG_CODE


def _discard_output() -> None:
    """What is still to come goes nowhere: the interpreter would complain about it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_standard_streams() -> None:
    """A closed standard stream becomes /dev/null: else the log's file could take its number, and be printed into."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):  # a letter that a terminal does not have is no reason to stop
        sys.stdout.reconfigure(errors="replace")


def _take_flags(args: list[str]) -> list[str]:
    """The arguments without --quiet and --no-progress, which every command takes, before or after its name."""
    end = args.index("--") if "--" in args else len(args)
    for flag, variable in _output.FLAGS.items():
        if flag in args[:end]:
            os.environ[variable] = "1"
    return [a for a in args[:end] if a not in _output.FLAGS] + args[end:]


def run_command(args: list[str]) -> int:
    args = _take_flags(args)
    if not args:
        print(_overview(), file=sys.stderr)
        return UsageError.exit_code
    name, rest = args[0], args[1:]
    if name in ("--help", "-h"):
        print(_overview())
        return 0
    if name == "--version":
        print(f"station {station.__version__}")
        return 0
    if name not in _modules():
        close = difflib.get_close_matches(name, _modules(), n=1)
        if close:
            raise UsageError("command-near", name=name[:40], nearest=close[0])
        raise UsageError("command-unknown", name=name[:40])
    return _run(name, rest)


def long_options(name: str) -> tuple[str, ...]:
    """The long options of a command, in the order of its help."""
    return tuple(o for p in _command(name).params for o in (*p.opts, *p.secondary_opts) if o.startswith("--"))


def _module(name: str) -> Any:
    """A command's module. `import` is a word of Python's own, so its file ends in an underscore."""
    return importlib.import_module("station.cli." + name.replace("-", "_") + ("_" if keyword.iskeyword(name) else ""))


@cache
def _command(name: str) -> Any:
    """What typer makes of a command's function."""
    import typer
    from typer.main import get_command

    function = _module(name).command
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command(name, help=_help(function))(_finite(name, function))
    return get_command(app)


def _finite(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """The command, which refuses numbers that are none: 'nan', 'inf' and those beyond a float's range."""

    @functools.wraps(function)
    def checked(**values: Any) -> Any:
        for key, value in values.items():
            numbers = value if isinstance(value, (list, tuple)) else (value,)
            for number in numbers:
                if isinstance(number, float) and not math.isfinite(number):
                    reason = Message("value-not-finite", given=number)
                    why = Message("option-wrong", option=f"--{key.strip('_').replace('_', '-')}", reason=reason)
                    raise UsageError("command-line-wrong", command=name, why=why)
        return function(**values)

    return checked


def _run(name: str, args: list[str]) -> int:
    import typer

    command = _command(name)
    if "--help" not in args:
        from station.cli._belonging import check_belonging

        check_belonging(name, _module(name), args)
    try:
        code = command.main(args, prog_name=f"station {name}", standalone_mode=False)
    except typer.TyperException as exc:
        from station.cli._command_line import command_line_error

        raise command_line_error(name, command.params, args, exc) from exc
    except typer.Abort as exc:
        raise Aborted("stopped-by-operator") from exc
    if code == _INTERRUPTED:
        raise Aborted("stopped-by-operator")
    return int(code or 0)


def _help(function: Callable[..., Any]) -> str:
    """The docstring, its indented blocks kept line by line."""
    text = "\n".join(line.removeprefix("    ") for line in (function.__doc__ or "").splitlines())
    return "\n\n".join(f"\b\n{part}" if part.startswith("  ") else part for part in text.strip().split("\n\n"))


#: A clause that is shorter says too little by itself: "Take a tour."
_TELLING = 32


def _first_clause(line: str) -> str:
    """What a command does, without the list after a colon or a semicolon, which its own help has, too: but where the
    list is what tells."""
    clause = line.partition(":")[0].partition(";")[0].rstrip(".") + "."
    return clause if len(clause) > _TELLING else line


def _overview() -> str:
    found = commands()
    width = max(map(len, found), default=0)
    columns = min(_output.screen_width(), 120)
    lines = [
        textwrap.fill(f"  {name:<{width}}  {_first_clause(line)}", columns, subsequent_indent=" " * (width + 4))
        for name, line in found.items()
    ]
    return "\n".join(
        [
            "Calibrates devices on a CAN bus: tumble, compute, judge, write, verify, log.",
            "",
            "Usage: station COMMAND [OPTIONS]   station COMMAND --help   station --version",
            "Every command takes --no-progress, and --quiet: neither progress nor remarks.",
            "",
            *lines,
            "",
            "Example: station run --simulate --units 4",
        ]
    )


def _fail(sentence: str, code: int) -> int:
    with suppress(OSError):  # where standard error is full, the exit code alone has to do
        _output.print_person(f"station: {sentence}")
    return code


def _write_crash_report(exc: Exception, args: list[str]) -> str:
    import platform
    import tempfile
    import traceback

    head = f"station {station.__version__}, Python {platform.python_version()}, {platform.platform()}\nstation {args}\n"
    with tempfile.NamedTemporaryFile("w", prefix="station-crash-", suffix=".txt", delete=False) as file:
        file.write(head + "".join(traceback.format_exception(exc)))
    return render(Message("station-bug", type=type(exc).__name__, file=file.name))


def _raise_interrupt(_number: int, _frame: Any) -> None:
    raise KeyboardInterrupt
