"""Wrong files and command lines for every command, made from right ones by a seeded random stream."""

import random
import re
import shutil
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from station.cli.app import commands, long_options
from station.config.search_path import shipped_folder
from station.errors import UsageError
from tests.fakes.command import Done, captured

#: What a library would say, and no person should read.
LEAKS = re.compile(
    r"input should|type=|pydantic|validation error|traceback|nonetype|object has no attribute|expecting value|"
    r"codec can|unhashable|errno|<class| at 0x[0-9a-f]{8,}|tokenizing|arrowinvalid|keyerror|"
    r"https?://errors|unsupported operand|\w+Warning: |"
    # PyYAML, SQLite, python-can, asyncio, PostgreSQL, OpenSSL
    r"found character|could not find expected|while (parsing|scanning|attempting)|mapping values are|"
    r"found undefined|block mapping|flow (sequence|mapping)|could not determine a constructor|"
    r"file is not a database|unable to open database|no such (table|column)|disk image|OperationalError|"
    r"unexpected file format|name or service not known|bind on address|connection is bad|connection to server|"
    r"is a directory|not a directory|no such file or directory|permission denied|file name too long|"
    r"embedded null|invalid literal|out of range for|could not convert|\bNoneType|\bttyp|\bstruct\.|"
    r"ASN\.1|unsupported PEM|could not deserialize|<\w+\.\w+",
    re.IGNORECASE,
)
_SENTENCES = re.compile(r"[a-z0-9)'`]\. [A-Z`]")
LONGEST_SENTENCE = 4000
#: How lines begin that a command may write before it refuses: whether what it reads is simulated.
_REMARKS = ("Rehearsal bench", "SIMULATED")
#: "Exit code" of a command that a test ended because it took too long: it had found its input right.
ENDED = -signal.SIGKILL
VALUES = (
    "", "null", "nan", ".nan", ".inf", "-.inf", "1e400", "-1", "0", "9" * 400, "true", "[]", "{}", "[1, 2",
    "!!python/object:os.system x", "!!binary aGk=", "*nobody", "&a [*a]", "text", "[[[[1]]]]", "{a: 1, a: 2}",
    "-0x", "1_000", "'", '"open', "2026-13-45", "\t- x", "@at", "`tick", "%percent", "é", "\u202e",
    "0b1", "1:30", "~", "<<", "- - -", "-", "--", "10 V", "1,5", "5%", "2026-02-30", "9999-12-31T25:00",
    "1969-12-31", "99999999999999", "SN0001/SN0002", "../x", "/dev/fd/9", "/proc/self/mem", "x" * 300,
    "日本", "=", "a=", "2026-11-21T06:00+99:00", "-7d", "1e9d",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class WrongInput:
    """A command line, and the file in it that is wrong ('' where it is the line itself)."""

    what: str
    words: tuple[str, ...]
    file: str = ""


@dataclass(frozen=True, slots=True)
class Complaint:
    """What is wrong with how a wrong input was refused."""

    wrong: WrongInput
    why: str
    sentence: str


def complaint(wrong: WrongInput, run: Callable[..., Done] = captured) -> Complaint | None:
    """Runs it; None where it was refused by one sentence of ours and the right code, or was right after all."""
    done = run(*wrong.words)
    why = _trouble(done)
    if why is None and done.returncode == UsageError.exit_code and not _names_file(wrong, done.stderr):
        why = "does not name the file"
    return None if why is None else Complaint(wrong, why, done.stderr.strip())


def _trouble(done: Done) -> str | None:
    """What is wrong with an answer."""
    lines = [line for line in done.stderr.splitlines() if line.partition(":")[0] not in _REMARKS]
    refusals = [line for line in lines if line.startswith("station: ")]
    refused = done.returncode == UsageError.exit_code
    found: dict[str, bool] = {
        f"exit code {done.returncode}": done.returncode not in (*range(5), ENDED),
        "a leak": LEAKS.search(done.stderr) is not None,
        "no sentence, or more than one": refused and (len(refusals) != 1 or _SENTENCES.search(refusals[0]) is not None),
        "more lines than the sentence's": refused and len(lines) > 1,
        "a sentence too long": any(len(line) > LONGEST_SENTENCE for line in refusals),
        "output of what was refused": refused and bool(done.stdout.strip()),
    }
    return ", ".join(what for what, there in found.items() if there) or None


def _names_file(wrong: WrongInput, sentence: str) -> bool:
    """What came to be a right file is refused for want of another one, or as the copy that was made of it."""
    named = (wrong.file, Path(wrong.file).stem, "nowhere", "new.", "There is no log", "accelerometer.dbc")
    return not wrong.file or any(name in sentence for name in named)


def wrong_lines(name: str, rng: random.Random, count: int) -> Iterator[WrongInput]:
    """Command lines of a command that no parser should take."""
    options = [o for o in long_options(name) if o != "--help"]
    for _ in range(count):
        option = rng.choice(options or ["--json"])
        kinds = (
            [option[:-1] + "x"], ["--no-such-option"], [option, "--"], [f"{option}=" + rng.choice(VALUES)],
            ["--" + "x" * rng.randint(1, 3000)], ["\x00", "\x1b[31m"], [option, "nowhere/at/all"], ["surplus"] * 5,
        )  # fmt: skip
        yield WrongInput("line", (name, *rng.choice(kinds), "--no-such-option"))


def wrong_texts(good: str, rng: random.Random, count: int) -> Iterator[tuple[str, bytes]]:
    """(what, content): a right text file made wrong in one place, or altogether."""
    whole: tuple[tuple[str, Callable[[], bytes]], ...] = (
        ("empty", lambda: b""),
        ("binary", lambda: rng.randbytes(rng.randint(1, 4000))),
        ("utf-16", lambda: good.encode("utf-16")),
        ("latin-1", lambda: good.encode("utf-8").replace(b"#", b"# \xe9\xff", 1)),
        ("truncated", lambda: good.encode("utf-8")[: rng.randint(1, len(good))]),
        ("nul", lambda: good.encode("utf-8").replace(b" ", b"\x00", 1)),
        ("twice", (good + "\n---\n" + good).encode),
        ("deep", lambda: b"a: " + b"[" * 5000),
        ("long line", lambda: good.encode() + b"x: " + b"y" * 200_000),
        ("shuffled", lambda: _shuffled(good, rng).encode()),
    )
    for i in range(count):
        if i % 3 == 0:
            what, make = rng.choice(whole)
            yield what, make()
        else:
            yield _one_line_wrong(good, rng)


def _shuffled(good: str, rng: random.Random) -> str:
    lines = good.splitlines()
    rng.shuffle(lines)
    return "\n".join(lines)


def _one_line_wrong(good: str, rng: random.Random) -> tuple[str, bytes]:
    lines = good.splitlines()
    places = [i for i, line in enumerate(lines) if re.search(r"[:=,]\s*\S", line) and not line.lstrip().startswith("#")]
    at = rng.choice(places or range(len(lines)))
    kind, value = rng.randrange(5), rng.choice(VALUES)
    line = lines[at]
    if kind == 0:
        lines[at] = re.sub(r"([:=,]\s*)[^,}\]]+", lambda m: m[1] + value, line, count=1)
    elif kind == 1:
        lines[at] = re.sub(r"\w+(?=\s*[:=,])", lambda m: m[0] + "x", line, count=1)
    elif kind == 2:
        lines.insert(at, line)
    elif kind == 3:
        del lines[at]
    else:
        numbers = list(re.finditer(r"[-+]?\d+(\.\d+)?", line))
        found = rng.choice(numbers) if numbers else None
        lines[at] = line + " ]" if found is None else line[: found.start()] + value + line[found.end() :]
    return f"line {at + 1}, kind {kind}, {value[:20]!r}", "\n".join(lines).encode("utf-8", "replace")


_DBC = str(shipped_folder() / "dbc" / "accelerometer.dbc")
#: What is made wrong: the right file, the name it gets, and the command line that reads it ({} is the file).
FILES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "recipe": ("recipes/six-point.yaml", "my.yaml", ("calibrate", "--samples", "nowhere.csv", "--recipe", "{}")),
    "recipe of a check": ("recipes/tilt-24.yaml", "my.yaml", ("backtest", "--recipe", "{}", "--db", "nowhere.db")),
    "product": ("dbc/accelerometer.yaml", "my.yaml", ("check", "--product", "{}")),
    "config": ("config.yaml", "my.yaml", ("stop", "--config", "{}")),
    "dbc": ("dbc/accelerometer.dbc", "my.dbc", ("init", "new", "--no-run", "--dbc", "{}", "--folder", "init")),
    "eds": (
        "dbc/accelerometer.eds", "my.eds",
        ("init", "new", "--no-run", "--dbc", _DBC, "--eds", "{}", "--folder", "init"),
    ),
    "samples": ("SAMPLES", "my.csv", ("calibrate", "--samples", "{}", "--recipe", "six-point")),
    "table": ("SAMPLES", "my.csv", ("import", "{}")),
    "recording": ("CANDUMP", "my.log", ("replay", "{}", "--recipe", "six-point")),
    "readings": ("READINGS", "my.csv", ("msa", "grr", "--samples", "{}", "--tolerance", "0.2")),
    "model": (
        "MODEL", "my.yaml",
        ("simulate", "--recipe", "one-point", "--units", "1", "--model", "{}", "--out", "out.csv"),
    ),
    "log": ("SAMPLES", "my.db", ("audit", "--db", "{}")),
    "parquet": ("SAMPLES", "my.parquet", ("calibrate", "--samples", "{}", "--recipe", "six-point")),
    "blf": ("SAMPLES", "my.blf", ("replay", "{}", "--recipe", "six-point")),
    "mat": ("SAMPLES", "my.mat", ("import", "{}")),
    "key": ("KEY", "my.pem", ("witness", "--key", "{}")),
}  # fmt: skip
_TEXTS = {
    "SAMPLES": "unit,run,visit,position,time_s,x,y,z\n"
    + "\n".join(f"SN0001,0,{v},z-up,{v + i / 100:.2f},0.01,0.02,1.0{i}" for v in range(6) for i in range(9)),
    "CANDUMP": "\n".join(f"(1700000000.{i:06d}) can0 181#00{i % 16:02X}00000000803E" for i in range(0, 9000, 100)),
    "READINGS": "part,appraiser,trial,value\n"
    + "\n".join(f"P{p},{a},{t},{p / 10 + t / 100}" for p in range(3) for a in "AB" for t in range(2)),
    "MODEL": "schema: station.model/1\neffects:\n  - {effect: quadratic, size: 0.001}\n",
    "KEY": "-----BEGIN PRIVATE KEY-----\nMC4CAQAwBQYDK2VwBCIEIA==\n-----END PRIVATE KEY-----\n",
}


def wrong_files(kind: str, folder: Path, rng: random.Random, count: int) -> Iterator[WrongInput]:
    """Files of one kind, each written just before it is given out; first a missing file and a folder."""
    source, name, words = FILES[kind]
    good = _TEXTS.get(source) or (shipped_folder() / source).read_text("utf-8", "replace")
    path = folder / name
    line = tuple(w.replace("{}", str(path)) for w in words)
    yield WrongInput(f"{kind}: missing", line, name)
    path.mkdir()
    yield WrongInput(f"{kind}: a folder", line, name)
    path.rmdir()
    for what, content in wrong_texts(good, rng, count):
        path.write_bytes(content)
        shutil.rmtree(folder / "init", ignore_errors=True)
        yield WrongInput(f"{kind}: {what}", line, name)
    path.unlink()


def all_commands() -> tuple[str, ...]:
    """Names of the commands."""
    return tuple(commands())
