"""The examples of every help, each made wrong in one word."""

import contextlib
import random
import shlex
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from station.cli.app import commands, long_options
from tests.fakes.help_examples import all_documented, words_of
from tests.fakes.wrong_inputs import VALUES, WrongInput

#: Files of the tour that are right, and of another kind than an option wants; a folder, and what is not there.
_OTHER_FILES = (
    "config.yaml", "station.db", "samples.csv", "samples.parquet", "readings.csv", "SN0042.log", "SN0042.pdf",
    "cold.mat", "drive.blf", "golden.json", "firmware.bin", "model.yaml", "station.key", "station.pub",
    "recipes/six-point.yaml", "dbc/accelerometer.dbc", "dbc/accelerometer.eds", "recipes", ".", "nowhere/at/all",
    "wrong/empty", "wrong/binary", "wrong/loop", "wrong/utf16.yaml", "wrong/keys.yaml", "wrong/anchor.yaml",
    "wrong/syntax.yaml", "wrong/other.yaml", "wrong/empty.csv", "wrong/binary.csv", "wrong/words.csv", "wrong/wide.csv",
    "wrong/cut.parquet", "wrong/cut.blf", "wrong/cut.mat", "wrong/cut.db", "wrong/foreign.db", "wrong/list.json",
    "wrong/cut.json", "wrong/empty.log", "wrong/binary.log", "wrong/binary.dbc", "wrong/binary.eds", "wrong/empty.bin",
)  # fmt: skip


def write_wrong_files(folder: Path) -> None:
    """`wrong` in a folder that `station demo` has left: files of every kind, none of them right."""
    wrong, noise = folder / "wrong", random.Random(1)
    wrong.mkdir()
    recipe = (folder / "recipes" / "six-point.yaml").read_text()
    (wrong / "loop").symlink_to("loop")
    for ending in ("", ".csv", ".log", ".bin"):
        (wrong / f"empty{ending}").touch()
    for ending in ("", ".csv", ".log", ".dbc", ".eds"):
        (wrong / f"binary{ending}").write_bytes(noise.randbytes(3000))
    for name, text in {
        "keys.yaml": recipe.replace("positions:", "positons:"),
        "anchor.yaml": recipe.replace("n-point", "*nobody").replace("positions:", "positions: *them"),
        "syntax.yaml": recipe.replace("name:", "name: [", 1),
        "other.yaml": "- 1\n- {a: b}\n",
        "words.csv": "time,ax,ay,az\none,two,three,four\n" * 9,
        "wide.csv": "a," * 5000 + "\n" + "1," * 9 + "\n",
        "list.json": "[1, 2, {}]",
        "cut.json": '{"schema": "station.golden/1", "units": {',
    }.items():
        (wrong / name).write_text(text)
    (wrong / "utf16.yaml").write_text(recipe, "utf-16")
    for name in ("samples.parquet", "drive.blf", "cold.mat", "station.db"):
        content = (folder / name).read_bytes()
        (wrong / f"cut{Path(name).suffix}").write_bytes(content[: len(content) // 2])
    with contextlib.closing(sqlite3.connect(wrong / "foreign.db")) as other:
        other.execute("create table records (a, b)")


def examples_of(name: str) -> list[list[str]]:
    """The words of every example of a command, without `station`."""
    lines = [words_of(line)[1:] for line in all_documented() if shlex.split(line)[1] == name]
    return lines or [[name]]


def all_names() -> tuple[str, ...]:
    """The commands whose examples can be made wrong: all but the tour itself."""
    return tuple(name for name in commands() if name != "demo")


def wrong_examples(name: str, rng: random.Random, count: int) -> Iterator[WrongInput]:
    """Command lines of a command, each an example with one thing changed for the worse."""
    examples, options = examples_of(name), [o for o in long_options(name) if o != "--help"]
    for _ in range(count):
        words = list(rng.choice(examples))
        value = rng.choice((*VALUES, *_OTHER_FILES))
        values = [i for i in range(1, len(words)) if not words[i].startswith("--")]
        kind = rng.randrange(7)
        if kind <= 2 and values:
            words[rng.choice(values)] = value
        elif kind == 6 and values:
            at = rng.choice(values)
            words[at : at + 1] = [words[at][:-1], words[at][: len(words[at]) // 2]]
        elif kind == 3 and len(words) > 1:
            del words[rng.randrange(1, len(words))]
        elif kind == 4 and options:
            words += [rng.choice(options), value]
        elif options:
            words += [f"{rng.choice(options)}={value}"]
        else:
            words.append(value)
        yield WrongInput(" ".join(word[:40] for word in words), tuple(words))
