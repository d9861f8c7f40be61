"""Hands broken input to everything that reads any, and counts what is neither taken nor refused in one sentence.

    python tests/endurance/torture_input.py [--inputs 100000] [--seed 1] [--json]

Every input is a good one (a shipped recipe, DBC, EDS, config, a written table or log) with a few mutations: bytes
changed, cut, doubled or swapped, lines repeated, and tokens put in that have broken parsers before. Faulty is an error
of any other type than the project's own, a sentence of several lines, a library that prints beside it, more than 5 s,
or more than 1 GiB.
"""

import argparse
import io
import json
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters import dbc
from station.adapters.bus import read_log, write_log
from station.adapters.canopen import eds
from station.adapters.samples import read_samples, write_samples
from station.adapters.simulated_device import device_fault
from station.config.documents import load_document, validate
from station.config.models import load_model
from station.config.products import load_product
from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.config.settings import load_config
from station.domain.can.decode import decode_samples
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.core.types import Frames, SampleTable
from station.domain.product.product import Product
from station.domain.recipe import serial
from station.errors import ProductError, StationError
from tests.endurance.fuzz_targets import Target, further_targets

MOST_S, MOST_BYTES = 5.0, 1 << 30
#: A recording that is read in a process of its own takes half a second: its turn comes once in so many rounds.
SELDOM = {"mf4": 40, "mat": 40}
RECIPE = shipped_folder() / "recipes" / "six-point.yaml"

#: What has broken parsers before.
TOKENS: Sequence[bytes] = (
    *(b"\0", b"\n", b"\r\n", b"\t", b'"', b"'", b"`", b"\\", b"\x1b[2J", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3\x28"),
    *("\u202e".encode(), "\u0000".encode(), "٣".encode(), "é".encode(), "💥".encode(), b"\x80", b"\xf4\x90\x80\x80"),
    *(b"nan", b"-inf", b"1e999", b"-0", b"0x", b"1_000", b"9" * 400, b"-1", b"4294967296", b"18446744073709551616"),
    *(b"&a [*a, *a]", b"*a", b"!!python/object/apply:os.system ['true']", b"!!binary x", b"<<: *a", b"? ", b"- " * 50),
    *(b"{" * 200, b"[" * 200, b"(" * 200, b"---", b"...", b"%YAML 9", b"'; DROP TABLE attempt;--", b"../../etc/passwd"),
    *(b"file:///etc/passwd", b"%s%n", b"${HOME}", b"A" * 5000, b",,,,", b";", b"NaN,NaN,NaN", b"1800sub0", b"$NODEID+"),
    *(b"SG_ X : 0|65@1+ (0,0) [0|0] \"\" X", b"BO_ 4294967295 X: 255 X", b"up: +q", b"null", b"true", b"2026-13-45"),
)  # fmt: skip


def targets(folder: Path) -> Mapping[str, Target]:
    """Everything that reads what people hand in."""
    product = load_product("accelerometer")
    files = shipped_folder() / "dbc"
    layout = resolve(product.frames, dbc.read_layouts(files / "accelerometer.dbc"))
    recipe = load_recipe(RECIPE)

    def scanned(path: Path) -> object:
        text = path.read_bytes().decode("utf-8", "surrogateescape")
        return serial.check_all(text.split("\n"), recipe)

    frames = _frames()
    return {
        "recipe": Target(RECIPE.read_bytes(), "r.yaml", load_recipe),
        "config": Target((shipped_folder() / "config.yaml").read_bytes(), "c.yaml", load_config),
        "product": Target((files / "accelerometer.yaml").read_bytes(), "p.yaml", _product),
        "model": Target(b"schema: station.model/1\neffects: []\n", "m.yaml", load_model),
        "dbc": Target((files / "accelerometer.dbc").read_bytes(), "a.dbc", dbc.read_layouts),
        "eds": Target((files / "accelerometer.eds").read_bytes(), "a.eds", lambda p: eds.load(p, 5)),
        "samples.csv": Target(_written(folder, "s.csv"), "s.csv", read_samples),
        "samples.parquet": Target(_written(folder, "s.parquet"), "s.parquet", read_samples),
        "candump": Target(_logged(folder, "f.log", frames), "f.log", read_log),
        "blf": Target(_logged(folder, "f.blf", frames), "f.blf", read_log),
        "asc": Target(ASC, "f.asc", read_log),
        "mf4": Target(_mf4(folder, frames), "f.mf4", read_log),
        "frames": Target(_packed(frames), "frames", partial(_decode, layout)),
        "serials": Target(b"SN0001\nSN0002\nSN123456789012", "serials", scanned),
        "fault": Target(b"refuse:index=0x2101,sub=1,code=0x06090030", "fault", _fault),
        **further_targets(folder),
    }


ASC = b"""date Thu Jan 1 00:00:00.000 am 2026
base hex  timestamps absolute
internal events logged
Begin Triggerblock Thu Jan 1 00:00:00.000 am 2026
 0.010000 1  191             Rx   d 8 00 01 02 03 04 05 06 07
 0.020000 1  191             Rx   d 8 10 01 02 03 04 05 06 07
End TriggerBlock
"""


def _frames(count: int = 30) -> Frames:
    rng = np.random.default_rng(3)
    data = rng.integers(0, 255, (count, 8), dtype=np.uint8)
    time_ns = 1_767_225_600_000_000_000 + np.arange(count) * 10_000_000
    return Frames(time_ns, np.full(count, 0x185, np.uint32), np.full(count, 8, np.uint8), data)


def _packed(frames: Frames) -> bytes:
    """Identifier, length and payload of each frame, 13 bytes."""
    rows = zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True)
    return b"".join(i.to_bytes(4, "little") + bytes([n]) + d.tobytes() for i, n, d in rows)


def _decode(layout: SensorLayout, path: Path) -> object:
    """Whatever comes as frames is decoded."""
    whole = path.read_bytes()
    rows = np.frombuffer(whole[: len(whole) // 13 * 13], np.uint8).reshape(-1, 13)
    can_id = np.ascontiguousarray(rows[:, :4]).view("<u4")[:, 0].astype(np.uint32)
    length = np.minimum(rows[:, 4], 8)
    return decode_samples(
        Frames(np.arange(len(rows)) * 10**7, can_id, length, np.ascontiguousarray(rows[:, 5:])), layout, 5
    )


def _product(path: Path) -> object:
    return validate(load_document(path, ProductError), Product, ProductError)


def _fault(path: Path) -> object:
    return device_fault.parse(path.read_bytes().decode("latin-1"))


def _written(folder: Path, name: str) -> bytes:
    path = folder / name
    from station.model.simulate import SimulationJob, simulate

    table: SampleTable = simulate(SimulationJob(load_recipe(RECIPE), ("SN0001",), seed=1)).table
    write_samples(table[:40], path)
    return path.read_bytes()


def _logged(folder: Path, name: str, frames: Frames) -> bytes:
    path = folder / name
    write_log(path, frames)
    return path.read_bytes()


def _mf4(folder: Path, frames: Frames) -> bytes:
    """As asammdf writes it: the station reads such recordings and writes none."""
    from station.adapters.bus._messages import to_message
    from station.adapters.bus._python_can import mf4

    writer = mf4().MF4Writer(folder / "f.mf4")
    for time_ns, can_id, data in zip(frames.time_ns.tolist(), frames.can_id.tolist(), frames.data, strict=True):
        writer.on_message_received(to_message(can_id, data.tobytes(), time_ns / 1e9))
    writer.stop()
    return (folder / "f.mf4").read_bytes()


def mutate(good: bytes, rng: np.random.Generator) -> bytes:
    """The input with one to eight mutations."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 9))):
        _MUTATIONS[int(rng.integers(len(_MUTATIONS)))](data, rng)
    return bytes(data)


def _at(data: bytearray, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    if data:
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))


def _put(data: bytearray, rng: np.random.Generator) -> None:
    at = _at(data, rng)
    data[at:at] = TOKENS[int(rng.integers(len(TOKENS)))]


def _replace(data: bytearray, rng: np.random.Generator) -> None:
    at = _at(data, rng)
    data[at : at + int(rng.integers(1, 12))] = TOKENS[int(rng.integers(len(TOKENS)))]


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    at = _at(data, rng)
    del data[at : at + int(rng.integers(1, 60))]


def _end(data: bytearray, rng: np.random.Generator) -> None:
    del data[_at(data, rng) :]


def _again(data: bytearray, rng: np.random.Generator) -> None:
    at = _at(data, rng)
    data[at:at] = data[at : at + int(rng.integers(1, 200))]


def _line(data: bytearray, rng: np.random.Generator) -> None:
    """Two lines change places, or one goes."""
    lines = bytes(data).split(b"\n")
    i, j = (int(v) for v in rng.integers(len(lines), size=2))
    if rng.random() < 0.5:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        del lines[i]
    data[:] = b"\n".join(lines)


_MUTATIONS = (_flip, _put, _replace, _cut, _end, _again, _line)


def attempt(target: Target, data: bytes, folder: Path) -> str:
    """'taken', 'refused', or what is wrong with how it ended; seconds are the processor's."""
    path = folder / target.name
    path.write_bytes(data)
    begun_s, heard = time.process_time(), io.StringIO()
    try:
        with redirect_stdout(heard), redirect_stderr(heard):
            target.read(path)
    except StationError as refused:
        shown = "refused" if "\n" not in refused.sentence and refused.sentence else f"sentence {refused.sentence!r}"
    except Exception as crash:  # noqa: BLE001 - any other type is what this looks for
        shown = f"{type(crash).__name__}: {crash}"[:200]
    else:
        shown = "taken"
    lasted_s = time.process_time() - begun_s
    if heard.getvalue():
        return f"a library printed {heard.getvalue()[:200]!r}"
    return shown if lasted_s < MOST_S else f"took {lasted_s:.1f} s"


def torture(inputs: int, seed: int, folder: Path) -> tuple[Counter[str], dict[str, bytes]]:
    """How often each target took and refused, and an input for each fault found."""
    rng = np.random.default_rng(seed)
    reading = targets(folder)
    counts: Counter[str] = Counter()
    faulty: dict[str, bytes] = {}
    for name, target in reading.items():
        shown = attempt(target, target.good, folder)
        if shown != "taken":
            faulty[f"{name}, untouched: {shown}"] = target.good
    names = list(reading)
    for number in range(inputs):
        name = names[number % len(names)]
        if number // len(names) % SELDOM.get(name, 1):
            name = names[0]
        data = mutate(reading[name].good, rng)
        shown = attempt(reading[name], data, folder)
        if shown in ("taken", "refused"):
            counts[f"{name} {shown}"] += 1
        else:
            faulty.setdefault(f"{name}: {shown}", data)
            counts[f"{name} FAULTY"] += 1
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if peak > MOST_BYTES:
        faulty[f"memory: {peak >> 20} MiB"] = b""
    return counts, faulty


def main() -> int:
    """Prints the counts; 1 when an input was faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    begun_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        counts, faulty = torture(given.inputs, given.seed, Path(folder))
    bad = sum(n for what, n in counts.items() if what.endswith("FAULTY"))
    shown = [f"{what}   input {data[:60]!r}" for what, data in list(faulty.items())[:40]]
    if given.json:
        print(json.dumps({"inputs": given.inputs, "faulty": bad, "seed": given.seed, "said": shown}))
        return int(bool(faulty))
    what = "hostile inputs with a traceback, over 5 s or over 1 GiB"
    print(f"{what}: {bad} of {given.inputs}   goal: 0   seed {given.seed}")
    print(f"  {time.perf_counter() - begun_s:.0f} s; " + ", ".join(f"{k} {v}" for k, v in sorted(counts.items())))
    for line in shown:
        print(f"  {line}")
    return int(bool(faulty))


if __name__ == "__main__":
    sys.exit(main())
