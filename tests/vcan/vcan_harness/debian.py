"""Programs from Debian packages: those installed, else fetched by apt as any user and unpacked in the cache."""

import os
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from vcan_harness import cache
from vcan_harness.command import run

PACKAGE_OF = {
    "ip": "iproute2",
    "tc": "iproute2",
    "kmod": "kmod",
    "linux.uml": "user-mode-linux",
    "candump": "can-utils",
    "canplayer": "can-utils",
    "cangen": "can-utils",
    "cansend": "can-utils",
    "softhsm2-util": "softhsm2",
}
_BIN = ("usr/bin", "usr/sbin", "bin", "sbin")
_FETCH_LIMIT_S = 300


class Unavailable(Exception):
    """Something that the tests need cannot be had; the message is a sentence with the remedy."""


def search_path() -> str:
    """PATH with the system folders first that a plain user's PATH lacks, then the cache."""
    system = ["/usr/local/sbin", "/usr/sbin", "/sbin"]
    return os.pathsep.join([os.environ.get("PATH", os.defpath), *system, *map(str, _cached(*_BIN))])


def library_path() -> str:
    """LD_LIBRARY_PATH with the fetched shared libraries."""
    given = filter(None, [os.environ.get("LD_LIBRARY_PATH")])
    return os.pathsep.join([*given, *map(str, _cached("usr/lib/*-linux-gnu*", "lib/*-linux-gnu*"))])


def provide(programs: Iterable[str]) -> dict[str, Path]:
    """Where each program is, fetching the packages of those missing. Errors: Unavailable."""
    wanted = tuple(programs)
    with cache.locked("debian"):
        missing = {PACKAGE_OF[name] for name in wanted if _find(name) is None}
        if missing:
            _fetch(sorted(missing))
    found = {name: _find(name) for name in wanted}
    absent = sorted(name for name, path in found.items() if path is None)
    if absent:
        raise Unavailable(f"The programs {', '.join(absent)} are in no package fetched; install them by hand.")
    return {name: path for name, path in found.items() if path is not None}


def _cached(*patterns: str) -> list[Path]:
    sets = (cache.folder() / "debian").glob("*")
    return [path for one in sorted(sets) for pattern in patterns for path in sorted(one.glob(pattern))]


def _find(program: str) -> Path | None:
    found = shutil.which(program, path=search_path())
    return Path(found) if found else None


def _fetch(packages: list[str]) -> None:
    """Downloads the packages and what they need beyond the installed ones, and unpacks all into one folder."""
    if not shutil.which("apt-get") or not shutil.which("dpkg-deb"):
        raise Unavailable(f"This system has no apt-get; install {', '.join(packages)} by its own means.")
    with tempfile.TemporaryDirectory(dir=cache.folder(), prefix="apt-") as work:
        archives, unpacked = Path(work) / "archives", Path(work) / "unpacked"
        (archives / "partial").mkdir(parents=True)
        _download(packages, archives, Path(work))
        for deb in sorted(archives.glob("*.deb")):
            if not deb.name.startswith("libc6"):  # the C library stays the one that runs already
                run("dpkg-deb", "-x", str(deb), str(unpacked), timeout_s=_FETCH_LIMIT_S)
        target = cache.folder() / "debian" / "+".join(packages)
        target.parent.mkdir(exist_ok=True)
        shutil.rmtree(target, ignore_errors=True)
        unpacked.rename(target)


def _download(packages: list[str], archives: Path, work: Path) -> None:
    """Tries the system's package lists; where they are missing or stale, lists of our own."""
    into = [f"Dir::Cache::archives={archives}/", f"Dir::Cache::pkgcache={work}/pkg.bin", "Dir::Cache::srcpkgcache="]
    install = ["install", "--download-only", "--no-install-recommends", "--yes", *packages]
    with suppress(OSError):
        return _apt(into, install)
    (work / "lists" / "partial").mkdir(parents=True)
    own = [*into, f"Dir::State={work}", f"Dir::State::lists={work}/lists/", "Dir::State::status=/var/lib/dpkg/status"]
    why = ""
    try:
        _apt([*own, "APT::Update::Error-Mode=any"], ["update"])
    except OSError as error:  # one dead source among several is no harm; what counts is the download
        why = f"{str(error).splitlines()[-1]}; "
    try:
        return _apt(own, install)
    except OSError as error:
        why += str(error).splitlines()[-1]
        raise Unavailable(f"apt-get cannot fetch {' '.join(packages)} ({why}); install them, or repair apt.") from error


def _apt(options: list[str], arguments: list[str]) -> None:
    """Runs apt-get without locks or a sandbox user, so that any user can fetch. Errors: OSError."""
    always = ["Debug::NoLocking=1", "APT::Sandbox::User=", "Acquire::Retries=1", "Acquire::http::Timeout=20"]
    settings = [word for option in (*always, *options) for word in ("-o", option)]
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C"}
    run("apt-get", "--quiet", *settings, *arguments, timeout_s=_FETCH_LIMIT_S, environment=environment)
