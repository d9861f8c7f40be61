"""Where a real kernel vcan comes from: a network namespace of this kernel, else a user-mode-linux guest."""

import os
import shutil
import socket
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote

from vcan_harness import debian
from vcan_harness.command import run

CAN_PROGRAMS = ("ip", "tc", "candump", "canplayer", "cangen", "cansend")
_GUEST_PROGRAMS = ("kmod", "linux.uml")
_GUEST_INIT = Path(__file__).with_name("guest_init.sh")
_GUEST_MEMORY_MB = 640
_KERNEL_ARGUMENTS = (
    *(f"mem={_GUEST_MEMORY_MB}M", "rootfstype=hostfs", "root=/dev/root", "rw", "quiet"),
    *("con=null", "con0=null,fd:1"),
)
# The guest's first process must not end, and a bare system has no poweroff: ask the kernel itself.
_HALT = f"exec {quote(sys.executable)} -c 'import ctypes; ctypes.CDLL(None).reboot(0x4321FEDC)'"
#: Folders that the guest covers with its own: nothing that the tests read from the host may be in them.
_COVERED = tuple(map(Path, ("/run", "/dev", "/proc", "/sys")))

_PROBE = f"""
ip link add vcan0 type vcan && ip link set vcan0 up &&
ip link add vx0 type vxcan peer name vx1 && ip link set vx0 up &&
tc qdisc add dev vx0 root tbf rate 128kbit burst 32 limit 2000 &&
{quote(sys.executable)} -c 'import socket as s; s.socket(s.AF_CAN, s.SOCK_RAW, s.CAN_RAW).bind(("vcan0",))'
"""


@dataclass(frozen=True)
class Way:
    """How to run a shell script where vcan exists.

    name: for people; command: words, `{script}` in them stands for the script's path; before, after: what the
    script does around the job itself; environment: added to the command's own.
    """

    name: str
    command: tuple[str, ...]
    before: str = ""
    after: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)


def find(work: Path, readable: tuple[Path, ...]) -> Way:
    """The first way that works here; `work` is this session's folder, `readable` the folders that tests read.

    Errors: Unavailable with the reasons of all.
    """
    debian.provide(CAN_PROGRAMS)
    refusals = []
    for isolate in (("unshare", "-n"), ("unshare", "-Urn")):
        refusal = _refusal_of_this_kernel(isolate)
        if refusal is None:
            own_folders = f"export HOME={quote(str(work))} TMPDIR={quote(str(work))}"
            return Way(f"this kernel, {os.uname().release}", (*isolate, "sh", "{script}"), before=own_folders)
        refusals.append(refusal)
    try:
        return _guest(work, readable)
    except debian.Unavailable as error:
        raise debian.Unavailable(f"No vcan can be had. This kernel: {refusals[-1]}. The guest: {error}") from error


def _refusal_of_this_kernel(isolate: tuple[str, ...]) -> str | None:
    """Why this kernel will not do, or None; opening the socket makes a modular kernel load its module."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return f"no AF_CAN ({error.strerror})"
    environment = {**os.environ, "PATH": debian.search_path(), "LD_LIBRARY_PATH": debian.library_path()}
    try:
        run(*isolate, "sh", "-c", _PROBE, timeout_s=60, environment=environment)
    except OSError as error:
        return f"{isolate[0]} {isolate[1]}: {str(error).splitlines()[-1]}"
    return None


def _guest(work: Path, readable: tuple[Path, ...]) -> Way:
    found = debian.provide(_GUEST_PROGRAMS)
    for path in (work, *readable):
        if any(path.is_relative_to(folder) for folder in _COVERED):
            raise debian.Unavailable(f"It covers {path}; put that elsewhere, not under /run or /dev.")
    linux = found["linux.uml"].resolve()
    modules = linux.parent.parent / "lib" / "uml" / "modules"
    (work / "insmod").symlink_to(found["kmod"])  # kmod acts by the name it is called by
    return Way(
        name=f"user-mode-linux, {', '.join(sorted(path.name for path in modules.iterdir()))}",
        command=("taskset", "-c", _one_processor(), str(linux), *_KERNEL_ARGUMENTS, "init={script}"),
        before=f"UML_MODULES={quote(str(modules))} INSMOD={quote(str(work / 'insmod'))}\n{_GUEST_INIT.read_text()}",
        after=_HALT,
        environment={"HOME": str(work), "TMPDIR": str(_memory_folder(work))},
    )


def _one_processor() -> str:
    """The guest traces its own processes; kept on one processor every switch is local, and the tests take half
    the time. Sessions side by side should not meet on the same one."""
    usable = sorted(os.sched_getaffinity(0))
    return str(usable[os.getpid() % len(usable)])


def _memory_folder(work: Path) -> Path:
    """Where the guest keeps its memory: shared memory when it is large enough (a container's often is not)."""
    shared = Path("/dev/shm")
    room = shutil.disk_usage(shared).free if shared.is_dir() and os.access(shared, os.W_OK) else 0
    return shared if room > 2 * _GUEST_MEMORY_MB * 1_000_000 else work
