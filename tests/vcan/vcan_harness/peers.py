"""Independent CANopen peers from npm, built into the cache from the pinned list in tests/vcan/peers."""

import hashlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

from vcan_harness import cache, toolchain
from vcan_harness.command import run

SCRIPTS = Path(__file__).parent.parent / "peers"
#: Set inside: the Node program, or else the sentence why there is none.
NODE, NODE_MISSING = "STATION_VCAN_NODE", "STATION_VCAN_NODE_MISSING"

_LISTS = ("package.json", "package-lock.json")
_LIMIT_S = 600


def provide() -> dict[str, str]:
    """Variables for the inner run. What cannot be had fails the tests that need it, not the others."""
    try:
        with cache.locked("node"):
            node = toolchain.node()
            return {NODE: str(node.program), "NODE_PATH": str(_modules(node))}
    except OSError as error:
        last = "\n".join(str(error).splitlines()[-15:])
        return {NODE_MISSING: f"The independent CANopen peers cannot be built; Node, npm, make or g++ fails:\n{last}"}


def _modules(node: toolchain.Node) -> Path:
    """node_modules for these lists and this Node; built at the first use."""
    version = run(str(node.program), "-p", "process.version + process.arch")
    pinned = b"".join((SCRIPTS / name).read_bytes() for name in _LISTS)
    target = cache.folder() / "node" / f"peers-{hashlib.sha256(pinned + version.encode()).hexdigest()[:12]}"
    if not target.is_dir():
        with tempfile.TemporaryDirectory(dir=cache.folder(), prefix="npm-") as work:
            _build(Path(work), node)
            target.parent.mkdir(exist_ok=True)
            (Path(work) / "peers").rename(target)
    return target / "node_modules"


def _build(work: Path, node: toolchain.Node) -> None:
    """npm ci, with the headers that came with Node: the native parts must not look for them elsewhere."""
    folder = work / "peers"
    folder.mkdir()
    for name in _LISTS:
        shutil.copy(SCRIPTS / name, folder)
    environment = {
        **os.environ,
        **toolchain.compiler(work),
        "PATH": f"{node.program.parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}",
        "npm_config_nodedir": str(node.prefix),
        "npm_config_python": sys.executable,
        "ZIG_GLOBAL_CACHE_DIR": str(work / "compiled"),
    }
    words = ("ci", "--no-audit", "--no-fund", "--foreground-scripts")
    run(*node.npm, *words, timeout_s=_LIMIT_S, folder=folder, environment=environment)
