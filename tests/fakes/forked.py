"""A command in a fork of the test's process: streams, folder and session of its own, and ended when it takes too long.

It starts in the time of a fork, ends with the exit code and the lines that a person gets, and cannot hang the test.
"""

import contextlib
import os
import select
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, NoReturn

from station.cli import app
from tests.fakes.command import Done


def forked(folder: Path, limit_s: float) -> Callable[..., Done]:
    """What runs `station WORDS…` in that folder, nobody at the keyboard; the exit code of one that took longer is that
    of SIGKILL."""
    return lambda *words: _run(words, folder, limit_s)


def _run(words: Sequence[str], folder: Path, limit_s: float) -> Done:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        sys.stdout.flush()
        sys.stderr.flush()
        child = os.fork()
        if child == 0:
            _be_command(words, folder, out, err)
        code = _wait(child, limit_s)
        return Done(code, _text(out), _text(err))


def _be_command(words: Sequence[str], folder: Path, out: IO[bytes], err: IO[bytes]) -> NoReturn:
    code = 70
    try:
        os.setsid()
        os.chdir(folder)
        with Path(os.devnull).open("rb") as nothing:
            os.dup2(nothing.fileno(), 0)
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        sys.stdin, sys.stdout, sys.stderr = (open(n, m, encoding="utf-8", closefd=False) for n, m in enumerate("rww"))  # noqa: SIM115
        app.main(list(words))
    except SystemExit as ended:
        code = int(ended.code or 0)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait(child: int, limit_s: float) -> int:
    """Exit code, or minus the number of the signal that ended it; whatever it started ends with it."""
    handle = os.pidfd_open(child)
    try:
        select.select([handle], [], [], limit_s)
    finally:
        os.close(handle)
    # The child heads its group until it is waited for: its number is nobody else's.
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode("utf-8", "replace")
