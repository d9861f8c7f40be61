"""Independent CANopen peers from npm, built into the cache from the pinned list in tests/vcan/peers."""

import hashlib
import os
import shutil
import tempfile
from pathlib import Path

from vcan_harness import cache, debian
from vcan_harness.command import run

SCRIPTS = Path(__file__).parent.parent / "peers"
#: Set inside: the Node program, or else the sentence why there is none.
NODE, NODE_MISSING = "STATION_VCAN_NODE", "STATION_VCAN_NODE_MISSING"

_PACKAGES_OF = {"node": ("nodejs", "libnode-dev"), "npm": ("npm",), "g++": ("g++",), "make": ("make",)}
_LIMIT_S = 300


def provide() -> dict[str, str]:
    """Variables for the inner run. What is missing fails the tests that need it, not the others."""
    try:
        node = _node()
        return {NODE: node, "NODE_PATH": str(_modules(node))}
    except debian.Unavailable as error:
        return {NODE_MISSING: str(error)}


def _node() -> str:
    missing = [program for program in _PACKAGES_OF if not shutil.which(program)]
    if missing:
        _install([package for program in missing for package in _PACKAGES_OF[program]])
    return str(shutil.which("node"))


def _install(packages: list[str]) -> None:
    remedy = f"The independent CANopen peers need Node and a compiler: apt-get install {' '.join(packages)}"
    if os.geteuid() != 0:
        raise debian.Unavailable(remedy)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        for words in (["update"], ["install", "--yes", "--no-install-recommends", *packages]):
            run("apt-get", "--quiet", *words, timeout_s=_LIMIT_S, environment=environment)
    except OSError as error:
        raise debian.Unavailable(f"{remedy} ({str(error).splitlines()[-1]})") from error


def _modules(node: str) -> Path:
    """node_modules for this list of packages and this Node; built at the first use."""
    version = run(node, "-p", "process.version + process.arch")
    pinned = b"".join((SCRIPTS / name).read_bytes() for name in ("package.json", "package-lock.json"))
    key = hashlib.sha256(pinned + version.encode()).hexdigest()[:16]
    target = cache.folder() / "node" / key
    with cache.locked("node"):
        if not target.is_dir():
            target.parent.mkdir(exist_ok=True)
            with tempfile.TemporaryDirectory(dir=cache.folder(), prefix="npm-") as work:
                _build(Path(work) / "peers", node)
                (Path(work) / "peers").rename(target)
    return target / "node_modules"


def _build(folder: Path, node: str) -> None:
    """npm ci, with the headers that came with Node: the native parts must not look for them elsewhere."""
    folder.mkdir()
    for name in ("package.json", "package-lock.json"):
        shutil.copy(SCRIPTS / name, folder)
    prefix = Path(node).resolve().parent.parent
    environment = {**os.environ, "npm_config_nodedir": str(prefix)}
    if not (prefix / "include" / "node" / "node_api.h").is_file():
        raise debian.Unavailable(
            f"{node} has no headers in {prefix}/include/node: install libnode-dev, or Node with them."
        )
    words = ("npm", "ci", "--no-audit", "--no-fund", "--foreground-scripts")
    try:
        run(*words, timeout_s=_LIMIT_S, folder=folder, environment=environment)
    except OSError as error:
        last = "\n".join(str(error).splitlines()[-12:])
        raise debian.Unavailable(f"npm cannot build the independent CANopen peers:\n{last}") from error
