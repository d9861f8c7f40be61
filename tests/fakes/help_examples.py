"""The examples that helps and guides show, and how each is tried in the folder that `station demo` leaves."""

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from station.cli.app import commands
from tests.fakes.serving import free_port

ROOT = Path(__file__).resolve().parents[2]
_CLI = ROOT / "station" / "cli"
GUIDES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```(?:sh|bash|)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_HELP_LINE = re.compile(r"^ {6}((?:station|openssl) .*)$", re.MULTILINE)
#: Ended by Ctrl-C, once they have said where they are.
_SERVERS = (
    ("panel",),
    ("witness",),
    ("device",),
    ("ship",),
    ("plant", "serve"),
    ("rig", "--simulate"),
    ("line", "--serve"),
)
#: Exit code 1 is an answer: a unit failed or holds a mixture, a diagnosis found something, a log waits for a decision.
ANSWERS = {"calibrate": (0, 1), "diagnose": (0, 1), "recover": (0, 1), "watch": (0, 1), "plant": (0, 1)}
#: What a server's line has that says where it is: an address, or a JSON document; a shift has brought back a load.
_READY = re.compile(r"://|^\{|handed back", re.MULTILINE)
#: Commands whose output a program reads.
FOR_PROGRAMS = ("schema", "completion")
KNOWN_BAD = "SN9002"
#: A server says where it is within this time.
START_S = 60.0
#: Characters of a line on the screen that the examples are tried on.
SCREEN = 80


@dataclass(frozen=True, slots=True)
class Tried:
    """How an example ended."""

    line: str
    code: int
    errors: str
    output: str = ""

    @property
    def right(self) -> bool:
        """Whether it ended as an example should."""
        words = shlex.split(self.line, comments=True)
        allowed = (1,) if words[1] == "run" and KNOWN_BAD in words else ANSWERS.get(words[1], (0,))
        if "save-torn" in self.line or "refuse:" in self.line or "power-cut" in self.line:
            allowed = (1, 3)  # a fault that the line itself asks for
        return self.code in allowed and not badly_laid_out(self.line, self.output, SCREEN)


def badly_laid_out(line: str, output: str, width: int) -> list[str]:
    """Lines of a command's output that leave the screen or are cut; a word that is longer than the screen stays whole,
    and what programs read is as wide as it is."""
    words = shlex.split(line, comments=True)
    if "--json" in words or "--markdown" in words or words[1] in FOR_PROGRAMS:
        return []
    return [
        text
        for text in output.splitlines()
        if text.endswith("…") or re.search(r"\d…", text) or (len(text) > width and len(text.split()) > 1)
    ]


def help_examples(name: str) -> list[str]:
    """Command lines in one command's help, without the tour that makes the folder."""
    done = subprocess.run([sys.executable, "-m", "station", name, "--help"], capture_output=True, text=True, check=True)
    return [line.strip() for line in _HELP_LINE.findall(done.stdout) if not line.startswith("station demo")]


def all_help_examples() -> list[str]:
    """Every command's."""
    return [line for name in commands() for line in help_examples(name)]


def all_documented() -> list[str]:
    """The same as the docstrings have them, without starting a process."""
    files = [_CLI / f"{name.replace('-', '_')}{'_' if name == 'import' else ''}.py" for name in commands()]
    lines = [
        line for file in files for line in re.findall(r"^ {8}(station .*)$", file.read_text("utf-8"), re.MULTILINE)
    ]
    return [line for line in lines if not line.startswith("station demo")]


def guide_examples(page: Path) -> list[str]:
    """Command lines in the blocks of a guide, in its order."""
    lines = [line for block in _BLOCK.findall(page.read_text(encoding="utf-8")) for line in block.splitlines()]
    known = {"openssl", *(f"station {name}" for name in commands() if name != "demo")}
    return [line for line in lines if {line.split(" ")[0], " ".join(line.split(" ")[:2])} & known and "→" not in line]


def words_of(line: str) -> list[str]:
    """The words of a line, up to where a shell would write its output into a file."""
    words = shlex.split(line, comments=True)
    return words[: words.index(">")] if ">" in words else words


def serves(line: str) -> bool:
    """Whether it goes on until Ctrl-C."""
    words = shlex.split(line, comments=True)
    endless = words[1:2] == ["line"] and "--loads" not in words
    return endless or (any(set(server) <= set(words) for server in _SERVERS) and "--add" not in words)


def needs_plant(line: str) -> bool:
    """Whether it needs a PostgreSQL; tests/plant has one."""
    return line.startswith("station plant") or "postgresql://" in line


def needs_person(line: str) -> bool:
    """Whether somebody must type a password; tests/integration/test_signatures.py does."""
    return line.startswith("station sign")


def try_example(line: str, folder: Path) -> Tried:
    """Runs one line as a process in the folder."""
    words = words_of(line)
    if words[0] == "station":
        words = [sys.executable, "-m", *words]
    if serves(line):
        return _try_server(line, words, folder)
    done = subprocess.run(
        words, capture_output=True, text=True, cwd=folder, stdin=subprocess.DEVNULL, timeout=600, check=False,
        env=os.environ | {"COLUMNS": str(SCREEN)},
    )  # fmt: skip
    return Tried(line, done.returncode, done.stderr, done.stdout)


def _try_server(line: str, words: list[str], folder: Path) -> Tried:
    """Starts it, waits until it says where it is, presses Ctrl-C."""
    with subprocess.Popen(
        words, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as server:
        assert server.stdout is not None
        late = threading.Timer(START_S, server.kill)
        late.start()
        output = ""
        while (read := server.stdout.readline()) and not _READY.search(output := output + read):
            pass
        late.cancel()
        server.send_signal(signal.SIGINT)
        output += server.communicate(timeout=60)[0]
    if "the address is in use" in output and "--port" not in words:
        # Another program of this machine holds the usual port.
        return _try_server(line, [*words, "--port", str(free_port())], folder)
    return Tried(line, server.returncode, output)
