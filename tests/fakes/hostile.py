"""Files of at most 10 MB that were made to exhaust whoever reads them, of every kind that the station reads."""

import gzip
import io
import json
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import yaml
from pyarrow import parquet

MOST_BYTES = 10_000_000
SAMPLES_HEADER = "unit,run,visit,position,time_s,x,y,z"
#: A line of `ax, ay, az` that any importer takes.
GOOD_ROWS = "t,ax,ay,az\n" + "".join(f"{i * 0.01:.2f},0.0,0.0,1.0\n" for i in range(400))
CANDUMP = "".join(f"(1767225600.{i * 1000:06d}) can0 185#0001020304050607\n" for i in range(50))


@dataclass(frozen=True, slots=True)
class HostileFile:
    """make: writes it into a folder; commands: what the station is asked there, each by itself."""

    name: str
    make: Callable[[Path], None]
    commands: tuple[tuple[str, ...], ...]


def _hostile(name: str, make: Callable[[Path], None], *commands: str) -> HostileFile:
    """commands: the words of each in one text."""
    return HostileFile(name, make, tuple(tuple(command.split()) for command in commands))


def every(shipped: Mapping[str, Path]) -> Iterator[HostileFile]:
    """All of them. shipped: the station's own `dbc`, `eds`, `recipe` and `config`, of which mutants are made."""
    yield from _texts()
    yield from _tables()
    yield from _matlab()
    yield from _recordings(shipped)
    yield from _documents(shipped)
    yield from _archives()


def _put(name: str, content: Callable[[], bytes | str]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        data = content()
        (folder / name).write_bytes((data.encode() if isinstance(data, str) else data)[:MOST_BYTES])

    return make


def _texts() -> Iterator[HostileFile]:
    """Tables as text, for `import`."""
    wide = ",".join(f"c{i}" for i in range(30_000))
    contents: dict[str, Callable[[], bytes | str]] = {
        "wide.csv": lambda: f"{wide}\n" + (",".join(["1.5"] * 30_000) + "\n") * 50,
        "one-line.csv": lambda: "1," * (MOST_BYTES // 2),
        "lines-of-999.csv": lambda: (",".join(["1"] * 999) + "\n") * 5000,
        "empty-cells.csv": lambda: ("," * 900 + "\n") * 11_000,
        "short-lines.csv": lambda: "1,2\n" * (MOST_BYTES // 4),
        "empty-lines.csv": lambda: GOOD_ROWS + "\n" * (MOST_BYTES - 10_000),
        "one-field.csv": lambda: GOOD_ROWS + '"' + "x" * (MOST_BYTES - 10_000) + '"\n',
        "open-quote.csv": lambda: GOOD_ROWS + '1,2,"' + "3,4\n" * (MOST_BYTES // 5),
        "quotes.csv": lambda: '"' * MOST_BYTES,
        "nul.csv": lambda: GOOD_ROWS.encode() + b"\0" * 5_000_000,
        "names.csv": lambda: "t,ax,ay,az,label\n" + "".join(f"{i},0,0,1,n{i}\n" for i in range(600_000)),
        "digits.csv": lambda: "t,ax,ay,az\n" + f"1,2,3,{'9' * 190_000}\n" * 50,
        "exponents.csv": lambda: "t,ax,ay,az\n" + "1e999999999,2,3,4\n" * 500_000,
        "clock.csv": lambda: "t,ax,ay,az\n" + "".join(f"{' ' * 60_000}1:2:3,0,0,1\n" for i in range(150)),
        "rate-comment.csv": lambda: "".join(f"# {'sampl' * 39_000}\n" for i in range(50)),
        "rate-comment-rows.csv": lambda: "".join(f"# {'sampl' * 39_000}\n" for i in range(45)) + GOOD_ROWS,
        "brackets.csv": lambda: "t,ax,ay,az\n" + f"{'(' * 199_000}\n" * 3 + GOOD_ROWS,
        "bracket-names.csv": lambda: f"t,ax,ay,{'[' * 190_000}\n" + "0.1,0,0,1\n" * 2000,
        "long-name.csv": lambda: f"t,ax,ay,{'a_' * 90_000}\n" + "0.1,0,0,1\n" * 2000,
        "keyed.txt": lambda: "".join("a:1," * 49_000 + "!\n" for i in range(50)),
        "keyed-dots.txt": lambda: ("ax:" + "1." * 90_000 + "\n") * 50,
        "keyed-letters.txt": lambda: ("a" * 199_000 + "\n") * 50,
        "keyed-blanks.txt": lambda: ("a:1" + " " * 190_000 + "!\n") * 50,
        "tabs.tsv": lambda: ("\t" * 900 + "\n") * 11_000,
        "blanks.txt": lambda: (" " * 199_000 + "1\n") * 50,
        "utf-16.csv": lambda: b"\xff\xfe" + ("1,2\n" * 1_200_000).encode("utf-16-le"),
        "numbered.csv": lambda: "t," + "x" + "[" * 90_000 + "0,y,z\n" + "0.1,0,0,1\n" * 2000,
        "pipes.txt": lambda: "|" * MOST_BYTES,
    }
    for name, content in contents.items():
        yield _hostile(name, _put(name, content), f"import {name}")
    yield _hostile("segment", _put("s.csv", contents["short-lines.csv"]), "segment s.csv --out o.csv")
    samples: dict[str, Callable[[], bytes | str]] = {
        "wide.csv": lambda: SAMPLES_HEADER + "," + wide + "\n",
        "one-field.csv": lambda: f"{SAMPLES_HEADER}\n" + "u" * 9_900_000 + ",0,0,z-up,0,0,0,1\n",
        "open-quote.csv": lambda: f'{SAMPLES_HEADER}\n"' + "u,0,0,z-up,0,0,0,1\n" * 500_000,
        "units.csv": lambda: SAMPLES_HEADER + "\n" + "".join(f"u{i},0,0,z-up,0,0,0,1\n" for i in range(300_000)),
        "visits.csv": lambda: SAMPLES_HEADER + "\n" + "".join(f"u,0,{i},z-up,{i},0,0,1\n" for i in range(300_000)),
        "runs.csv": lambda: SAMPLES_HEADER + "\n" + "".join(f"u,{i},0,z-up,{i},0,0,1\n" for i in range(300_000)),
        "positions.csv": lambda: SAMPLES_HEADER + "\n" + "".join(f"u,0,{i},p{i},{i},0,0,1\n" for i in range(300_000)),
        "columns.csv": lambda: (
            SAMPLES_HEADER
            + "".join(f",a{i}" for i in range(480))
            + "\n"
            + ("u,0,0,z-up,0,0,0,1" + "," * 480 + "\n") * 19_000
        ),
        "same.csv": lambda: SAMPLES_HEADER + "\n" + "u,0,0,z-up,0,0,0,1\n" * 500_000,
    }
    for name, content in samples.items():
        yield _hostile(f"samples {name}", _put(name, content), *(
            f"{ask} --samples {name} --recipe six-point" for ask in ("calibrate", "diagnose")))  # fmt: skip
    readings = _put("m.csv", lambda: "value\n" + "1\n" * 4_900_000)
    yield _hostile("readings of a study", readings, "msa type1 --samples m.csv --tolerance 1 --reference 1")


def _tables() -> Iterator[HostileFile]:
    """Parquet."""
    asks = ("import p.parquet", *(f"{a} --samples p.parquet --recipe six-point" for a in ("calibrate", "diagnose")))
    for name, make in _PARQUETS.items():
        yield _hostile(f"parquet {name}", make, *asks)


def _samples_columns(rows: int) -> dict[str, pa.Array]:
    zeros = pa.array(np.zeros(rows))
    whole = pa.array(np.zeros(rows, np.int64))
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["z-up"]))
    return {"unit": text, "run": whole, "visit": whole, "position": text, "time_s": zeros, "x": zeros, "y": zeros,
            "z": zeros}  # fmt: skip


def _zeros(folder: Path) -> None:
    """Gigabytes of zeros."""
    _write(folder, pa.table(_samples_columns(3_000_000)), compression="zstd")


def _write(folder: Path, table: pa.Table, **options: object) -> None:
    parquet.write_table(table, str(folder / "p.parquet"), **options)
    assert (folder / "p.parquet").stat().st_size <= MOST_BYTES


def _wide(folder: Path) -> None:
    _write(folder, pa.table({**_samples_columns(4), **{f"c{i}": pa.array([0.0] * 4) for i in range(12_000)}}))


def _long_text(folder: Path) -> None:
    """One name of a hundred megabytes in each of some rows."""
    text = pa.array(["u" * 100_000_000] * 12)
    columns = {**_samples_columns(12), "unit": text}
    _write(folder, pa.table(columns), compression="zstd", use_dictionary=False)


def _repeated_text(folder: Path) -> None:
    """A dictionary of one name of a megabyte, and a hundred thousand rows of it."""
    rows = 100_000
    name = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["u" * 1_000_000]))
    _write(folder, pa.table({**_samples_columns(rows), "unit": name, "lot": name}), compression="zstd")


def _shared_prefixes(folder: Path) -> None:
    """Names of a megabyte that share all but their ends, which DELTA_BYTE_ARRAY packs into nothing."""
    rows = 700
    names = pa.array(["u" * 1_000_000 + str(i) for i in range(rows)])
    _write(folder, pa.table({**_samples_columns(rows), "unit": names}), use_dictionary=False, compression="zstd",
           column_encoding={"unit": "DELTA_BYTE_ARRAY"})  # fmt: skip


def _nested(folder: Path) -> None:
    deep = pa.array([1])
    for _ in range(200):
        deep = pa.StructArray.from_arrays([deep], ["s"])
    _write(folder, pa.table({**_samples_columns(1), "deep": deep}))


def _lists(folder: Path) -> None:
    """One row that is a list of a hundred million zeros."""
    column = pa.ListArray.from_arrays(pa.array([0, 100_000_000], pa.int32()), pa.array(np.zeros(100_000_000, np.int8)))
    _write(folder, pa.table({**_samples_columns(1), "list": column}), compression="zstd")


def _lying(folder: Path) -> None:
    """Sizes in the footer are made small: only the pages themselves tell."""
    text = pa.array(["u" * 200_000_000] * 6)
    _write(folder, pa.table({**_samples_columns(6), "unit": text}), compression="zstd",
           use_dictionary=False, write_statistics=False)  # fmt: skip
    path = folder / "p.parquet"
    with parquet.ParquetFile(str(path)) as file:
        group = file.metadata.row_group(0)
        sizes = {group.total_byte_size} | {group.column(i).total_uncompressed_size for i in range(group.num_columns)}
    data = path.read_bytes()
    for size in sizes:
        data = data.replace(_zigzag(size), _zigzag(size % 100).ljust(len(_zigzag(size)), b"\0"))
    path.write_bytes(data)


def _zigzag(number: int) -> bytes:
    """As Thrift's compact protocol writes a positive number."""
    number, out = number << 1, bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def _cut(folder: Path) -> None:
    """A footer that is longer than its file."""
    (folder / "p.parquet").write_bytes(b"PAR1" + b"\xff" * 9_000_000 + b"\xff\xff\xff\x7fPAR1")


_PARQUETS: dict[str, Callable[[Path], None]] = {
    "zeros": _zeros, "wide": _wide, "long text": _long_text, "repeated text": _repeated_text,
    "shared prefixes": _shared_prefixes, "nested": _nested, "lists": _lists, "lying": _lying,
    "cut": _cut,
}  # fmt: skip


def _element(kind: int, data: bytes) -> bytes:
    """A data element of a MAT 5 file, padded to eight bytes."""
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def _matrix(name: str, dims: tuple[int, ...], inner: bytes, kind: int = 6) -> bytes:
    """An miMATRIX element: flags, dimensions, name, content. kind 6: doubles; 1: cells; 2: struct."""
    head = _element(6, struct.pack("<II", kind, 0)) + _element(5, struct.pack(f"<{len(dims)}i", *dims))
    return _element(14, head + _element(1, name.encode()) + inner)


_MAT_HEAD = b"MATLAB 5.0 MAT-file, hostile".ljust(124) + b"\x00\x01IM"


def _packed(element: bytes) -> bytes:
    return struct.pack("<II", 15, len(packed := zlib.compress(element, 9))) + packed


def _zero_matrix(count: int) -> bytes:
    """Doubles of nothing, in pieces: the element is too large to hold twice."""
    packer = zlib.compressobj(9)
    body = 8 * count
    head = _element(6, struct.pack("<II", 6, 0)) + _element(5, struct.pack("<2i", count, 1)) + _element(1, b"x")
    head += struct.pack("<II", 9, body)
    out = [packer.compress(struct.pack("<II", 14, len(head) + body) + head)]
    out += [packer.compress(bytes(1 << 20)) for _ in range(body >> 20)]
    out.append(packer.compress(bytes(body & ((1 << 20) - 1))) + packer.flush())
    packed = b"".join(out)
    return struct.pack("<II", 15, len(packed)) + packed


def _deep_cells(depth: int) -> bytes:
    inner = _matrix("", (1, 1), _element(9, bytes(8)))
    for _ in range(depth):
        inner = _matrix("", (1, 1), inner, kind=1)
    return _matrix("x", (1, 1), inner, kind=1)


def _matlab() -> Iterator[HostileFile]:
    empty = _matrix("", (0, 0), b"")
    contents: dict[str, Callable[[], bytes | str]] = {
        "zeros": lambda: _MAT_HEAD + _zero_matrix(130_000_000),
        "many zeros": lambda: _MAT_HEAD + b"".join([_zero_matrix(15_000_000)] * 12),
        "dims": lambda: _MAT_HEAD + _matrix("x", (2**31 - 1, 2**31 - 1), _element(9, bytes(80))),
        "cell dims": lambda: _MAT_HEAD + _matrix("x", (2**31 - 1, 1), empty, kind=1),
        "cells": lambda: _MAT_HEAD + _matrix("x", (90_000, 1), empty * 90_000, kind=1),
        "packed cells": lambda: _MAT_HEAD + _packed(_matrix("x", (9_000_000, 1), empty * 9_000_000, kind=1)),
        "deep cells": lambda: _MAT_HEAD + _deep_cells(3000),
        "names": lambda: _MAT_HEAD + b"".join(
            _matrix(f"v{i}", (10, 1), _element(9, bytes(80))) for i in range(45_000)),
        "version 4": lambda: struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"x\0" + bytes(800),
        "version 4 long name": lambda: struct.pack("<5i", 0, 2, 2, 0, 2**31 - 1) + b"x\0" + bytes(800),
        "chars": lambda: _MAT_HEAD + _packed(_matrix("x", (1, 2**28), _element(4, bytes(2**29)), kind=4)),
        "version 7.3": lambda: b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(9_000_000),
    }  # fmt: skip
    for name, content in contents.items():
        yield _hostile(f"mat {name}", _put("m.mat", content), "import m.mat")


def _blf(containers: list[bytes]) -> bytes:
    """A BLF of such containers."""
    head = b"LOGG" + struct.pack("<L", 144)
    out = [head.ljust(144, b"\0")]
    for data in containers:
        body = struct.pack("<H6xL4x", 2, 0) + data
        size = 16 + len(body)
        out.append(struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10) + body + b"\0" * (size % 4))
    return b"".join(out)


_CAN_MESSAGE = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 48, 1) + struct.pack("<LHHQ", 1, 0, 0, 10) + struct.pack(
    "<HBBL8s", 1, 0, 8, 0x185, bytes(8))  # fmt: skip


def _mf4_of_zeros(folder: Path) -> None:
    """Signals of nothing, as asammdf compresses them."""
    from asammdf import MDF, Signal

    zeros = np.zeros(40_000_000)
    with MDF() as made:
        made.append([Signal(zeros, zeros, name="ax"), Signal(zeros, zeros, name="ay")])
        made.save(folder / "f.mf4", overwrite=True, compression=2)
    assert (folder / "f.mf4").stat().st_size <= MOST_BYTES


def _recordings(shipped: Mapping[str, Path]) -> Iterator[HostileFile]:
    """CAN logs and marks, for `replay` and `import`."""
    zeros = zlib.compress(bytes(60 << 20), 9)
    frames = zlib.compress(_CAN_MESSAGE * ((60 << 20) // 48), 9)
    logs: dict[str, tuple[str, Callable[[], bytes | str]]] = {
        "blf of zeros": ("f.blf", lambda: _blf([zeros] * (MOST_BYTES // (len(zeros) + 40)))),
        "blf of frames": ("f.blf", lambda: _blf([frames] * (MOST_BYTES // (len(frames) + 40)))),
        "blf of one container": ("f.blf", lambda: _blf([zlib.compress(bytes(1 << 30), 9)])),
        "blf of empty objects": ("f.blf", lambda: b"LOGG" + struct.pack("<L", 144) + bytes(136)
                                 + struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16, 99) * (MOST_BYTES // 16 - 20)),
        "candump long line": ("f.log", lambda: CANDUMP + "(" * (MOST_BYTES - 5000)),
        "candump digits": ("f.log", lambda: CANDUMP + "(" + "1" * (MOST_BYTES - 5000) + ".0) can0 1#\n"),
        "candump hex": ("f.log", lambda: CANDUMP + "(1.0) can0 185#" + "00" * (MOST_BYTES // 2 - 5000) + "\n"),
        "candump channel": ("f.log", lambda: CANDUMP + "(1.0) " + "c" * (MOST_BYTES - 5000) + "\n"),
        "candump blanks": ("f.log", lambda: CANDUMP + ("(1.0)" + " " * 100_000 + "x\n") * 90),
        "candump short frames": ("f.log", lambda: "(1.0) c 1#\n" * (MOST_BYTES // 11)),
        "candump fd": ("f.log", lambda: "(1.0) c 1##0\n" * (MOST_BYTES // 14) + "(1.0) c 1##0" + "00" * 64 + "\n"),
        "candump empty lines": ("f.log", lambda: "\n" * MOST_BYTES),
        "asc long line": ("f.asc", lambda: "date Thu Jan 1 00:00:00.000 am 2026\nbase hex  timestamps absolute\n"
                          + "0.01 1 191 Rx d 8 " + "00 " * 3_000_000),
        "asc short lines": ("f.asc", lambda: "date Thu Jan 1 00:00:00.000 am 2026\nbase hex  timestamps absolute\n"
                            + "0.1 1 1x Rx d 0\n" * 600_000),
        "asc headers": ("f.asc", lambda: "date Thu Jan 1 00:00:00.000 am 2026\n" * 250_000),
    }  # fmt: skip
    dbc = shipped["dbc"].read_bytes()
    for name, (file, content) in logs.items():
        make = _both(_put(file, content), _put("a.dbc", lambda: dbc))
        yield _hostile(name, make, f"replay {file} --dbc a.dbc", f"import {file} --dbc a.dbc")
    make = _both(_mf4_of_zeros, _put("a.dbc", lambda: dbc))
    yield _hostile("mf4 of zeros", make, "import f.mf4", "replay f.mf4 --dbc a.dbc")
    mark = {"unit": "u", "node": 5, "run": 0, "visit": 0, "position": "z-up", "start_s": 0, "end_s": 0.01}
    marks: dict[str, Callable[[], bytes | str]] = {
        "many": lambda: json.dumps({"schema": "station.marks/1", "recipe": "six-point",
                                    "marks": [{**mark, "visit": i} for i in range(80_000)]}),
        "deep": lambda: "[" * MOST_BYTES,
        "deep object": lambda: '{"a":' * (MOST_BYTES // 5),
        "digits": lambda: '{"marks": [{"visit": ' + "9" * 9_000_000 + "}]}",
        "keys": lambda: "{" + ",".join(f'"k{i}":0' for i in range(800_000)) + "}",
    }  # fmt: skip
    for name, content in marks.items():
        make = _both(_put("f.log", lambda: CANDUMP), _put("f.log.marks.json", content))
        yield _hostile(f"marks {name}", make, "replay f.log --recipe six-point")
    table = ",".join(mark)
    rows = "u,5,0,0,z-up,0,0.01\n"
    make = _both(_put("f.log", lambda: CANDUMP), _put("f.log.marks.csv", lambda: table + "\n" + rows * 500_000))
    yield _hostile("marks table", make, "replay f.log --recipe six-point")


def _both(*makes: Callable[[Path], None]) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for one in makes:
            one(folder)

    return make


def _laughs(text: str) -> str:
    """A billion laughs in front of a document."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    return "\n".join([*lines, text])


def _documents(shipped: Mapping[str, Path]) -> Iterator[HostileFile]:
    """YAML, DBC, EDS, JSON."""
    recipe = shipped["recipe"].read_text()
    many = yaml.safe_load(recipe)
    texts: dict[str, Callable[[], bytes | str]] = {
        "laughs": lambda: _laughs(recipe),
        "merge": lambda: "a: &a {b: 1}\n" + "".join(f"a{i}: {{<<: *a}}\n" for i in range(100_000)),
        "deep flow": lambda: "a: " + "[" * 4_000_000,
        "deep block": lambda: "".join(f"{' ' * i}a:\n" for i in range(1300)),
        "dashes": lambda: "- " * 490_000,
        "long key": lambda: "? " + "k" * 900_000 + "\n: 1\n",
        "positions": lambda: yaml.safe_dump({**many, "positions": [
            {"name": f"p{i}", "up": "+x"} for i in range(15_000)]}),
        "ten megabytes": lambda: recipe + "#" * 9_900_000,
        "pattern": lambda: recipe + '\nserial_pattern: "SN(0+)+$"\n',
        "long pattern": lambda: recipe + '\nserial_pattern: "' + "(a|b)*" * 100_000 + '"\n',
        "repeats": lambda: recipe + '\nserial_pattern: "((((a{1,1000}){1,1000}){1,1000}){1,1000})"\n',
        "number": lambda: recipe.replace("version:", "version: " + "9" * 500_000 + "\nversion2:", 1),
    }  # fmt: skip
    for name, content in texts.items():
        yield _hostile(f"recipe {name}", _put("r.yaml", content), "check ./r.yaml")
    simulate = "simulate --recipe {} --units 1 --out o.csv"
    for name in ("laughs", "deep flow", "dashes"):
        yield _hostile(f"document {name}", _put("d.yaml", texts[name]), "check six-point --config d.yaml",
                       f"{simulate.format('six-point')} --model d.yaml")  # fmt: skip
    endless = _put("r.yaml", lambda: recipe.replace("time_s: 1.0", "time_s: 1.0e12"))
    yield _hostile("endless dwell", endless, simulate.format("./r.yaml"),
                   "run --simulate --recipe ./r.yaml --units 1 --db s.db", "check ./r.yaml")  # fmt: skip
    yield from _devices(shipped)


def _devices(shipped: Mapping[str, Path]) -> Iterator[HostileFile]:
    dbc, eds = shipped["dbc"].read_text(), shipped["eds"].read_text(encoding="latin-1")
    message = 'BO_ {} M{}: 8 X\n SG_ S : 0|16@1+ (1,0) [0|0] "" X\n\n'
    dbcs: dict[str, Callable[[], str]] = {
        "messages": lambda: dbc + "".join(message.format(i % 2**29 | 1 << 31, i) for i in range(60_000)),
        "signals": lambda: dbc + "BO_ 99 M: 64 X\n" + "".join(
            f' SG_ S{i} : {i % 512}|1@1+ (1,0) [0|0] "" X\n' for i in range(80_000)) + "\n",
        "same signals": lambda: dbc + "BO_ 99 M: 64 X\n" + ' SG_ S : 0|64@1+ (1,0) [0|0] "" X\n' * 80_000 + "\n",
        "broken messages": lambda: dbc + "".join(
            f'BO_ {i + 1000} M{i}: 8 X\n SG_ S : 0|999@1+ (1,0) [0|0] "" X\n\n' for i in range(20_000)),
        "faults": lambda: dbc + "BO_ x M: 8 X\n" * 200_000,
        "open string": lambda: dbc + 'CM_ "' + "x" * 3_900_000,
        "comments": lambda: dbc + "".join(f'CM_ BO_ {i} "x";\n' for i in range(150_000)),
        "values": lambda: dbc + "VAL_ 99 S " + " ".join(f'{i} "v"' for i in range(300_000)) + ";\n",
        "blanks": lambda: dbc + " " * 3_900_000,
        "ten megabytes": lambda: dbc + "\n" * 9_900_000,
        "nodes": lambda: dbc.replace("BU_:", "BU_: " + " ".join(f"N{i}" for i in range(400_000)), 1),
    }  # fmt: skip
    for name, content in dbcs.items():
        make = _both(_put("f.log", lambda: CANDUMP), _put("a.dbc", content))
        yield _hostile(f"dbc {name}", make, "replay f.log --dbc a.dbc", "init p --dbc a.dbc --no-run")
    entry = "[{:04X}sub{:X}]\nParameterName=x\nObjectType=7\nDataType=7\nAccessType=rw\n\n"
    edses: dict[str, Callable[[], str]] = {
        "objects": lambda: eds + "".join(entry.format(0x2000 + i % 0x8000, i // 0x8000) for i in range(45_000)),
        "sections": lambda: eds + "".join(f"[s{i}]\n" for i in range(450_000)),
        "compact": lambda: eds + "".join(
            f"[{0x3000 + i:04X}]\nParameterName=x\nObjectType=8\nDataType=7\nAccessType=rw\nCompactSubObj=254\n\n"
            for i in range(20_000)),
        "broken": lambda: eds + "".join(
            f"[{0x3000 + i:04X}]\nParameterName=x\nObjectType=7\nDataType=z\nAccessType=rw\n\n" for i in range(20_000)),
        "long value": lambda: eds + "\n[3000]\nParameterName=" + "x" * 3_900_000,
        "continuations": lambda: eds + "\n[3000]\nParameterName=x\n" + " y\n" * 1_200_000,
        "comments": lambda: eds + ";" * 3_900_000,
        "same section": lambda: eds + "[3000]\nParameterName=x\n" * 150_000,
        "list": lambda: eds + "\n[MandatoryObjects]\nSupportedObjects=999999999\n",
        "ten megabytes": lambda: eds + "\n" * 9_900_000,
    }  # fmt: skip
    good = shipped["dbc"].read_bytes()
    for name, content in edses.items():
        make = _both(_put("a.dbc", lambda: good), _put("a.eds", content))
        yield _hostile(f"eds {name}", make, "init p --dbc a.dbc --eds a.eds --no-run")


def _endless_log(folder: Path) -> None:
    """A database whose tables are views that never end."""
    db = sqlite3.connect(folder / "h.db")
    numbers = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
    db.execute(f"CREATE VIEW meta AS {numbers} SELECT 'schema' AS key, i AS value FROM n")
    db.commit()
    db.close()


def _archives() -> Iterator[HostileFile]:
    """What is no table at all, logs, bundles, the run's own small files."""

    def bomb() -> bytes:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as made:
            made.writestr("xl/worksheets/sheet1.xml", bytes(1 << 30))
            made.writestr("records.jsonl", bytes(1 << 30))
        return buffer.getvalue()

    for name in ("book.xlsx", "bomb.csv"):
        yield _hostile(f"ZIP as {name}", _put(name, bomb), f"import {name}")
    yield _hostile("gzip", _put("t.csv.gz", lambda: gzip.compress(bytes(1 << 30))), "import t.csv.gz")
    yield _hostile("endless log", _endless_log, "audit --db h.db", "audit --verify --db h.db")
    yield _hostile("log of zeros", _put("h.db", lambda: bytes(MOST_BYTES)), "audit --db h.db")
    states = {"deep": "[" * 9_000_000, "keys": '{"objects": {' + '"2101:01": 1,' * 500_000 + '"a": 1}}'}
    for name, text in states.items():
        make = _both(lambda folder: (folder / "state").mkdir(), _put("state/SN0001.json", partial(str, text)))
        run = "run --simulate --recipe six-point --units 1 --db s.db --device-state state"
        yield _hostile(f"device state {name}", make, run)
