"""The examples of every help, each made wrong in one word."""

import random
import shlex
from collections.abc import Iterator

from station.cli.app import commands, long_options
from tests.fakes.help_examples import all_documented, words_of
from tests.fakes.wrong_inputs import VALUES, WrongInput

#: Files of the tour that are right, and of another kind than an option wants; a folder, and what is not there.
_OTHER_FILES = (
    "config.yaml", "station.db", "samples.csv", "samples.parquet", "readings.csv", "SN0042.log", "SN0042.pdf",
    "cold.mat", "drive.blf", "golden.json", "firmware.bin", "model.yaml", "station.key", "station.pub",
    "recipes/six-point.yaml", "dbc/accelerometer.dbc", "dbc/accelerometer.eds", "recipes", ".", "nowhere/at/all",
)  # fmt: skip


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
        kind = rng.randrange(6)
        if kind <= 2 and values:
            words[rng.choice(values)] = value
        elif kind == 3 and len(words) > 1:
            del words[rng.randrange(1, len(words))]
        elif kind == 4 and options:
            words += [rng.choice(options), value]
        elif options:
            words += [f"{rng.choice(options)}={value}"]
        else:
            words.append(value)
        yield WrongInput(" ".join(word[:40] for word in words), tuple(words))
