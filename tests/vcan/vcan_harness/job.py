"""One run of the guest tests where vcan exists, and the stream of their reports back out."""

import json
import os
import shlex
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vcan_harness import debian
from vcan_harness.ways import Way

#: Set inside: the file that takes one JSON report a line.
REPORTS = "STATION_VCAN_REPORTS"
#: Longest silence between two reports; a test's own time-out inside is shorter.
SILENCE_LIMIT_S = 180.0
_POLL_S = 0.05
#: Ends a job whose session was killed.
_LIFETIME = ("timeout", "--kill-after=5", "1200")


class Job:
    """The inner pytest: started once, read as it goes, killed when it falls silent."""

    def __init__(
        self, way: Way, work: Path, root: Path, arguments: Sequence[str], variables: Mapping[str, str]
    ) -> None:
        self.way, self._work, self._reports = way, work, work / "reports.jsonl"
        self.console = work / "console.log"
        self._reports.touch()
        script = work / "job.sh"
        script.write_text(self._script(root, arguments, variables))
        script.chmod(0o755)
        command = [word.replace("{script}", str(script)) for word in way.command]
        with self.console.open("w") as console:
            self._process = subprocess.Popen(
                [*_LIFETIME, *command],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                env={"PATH": os.environ.get("PATH", os.defpath), **way.environment},
                start_new_session=True,
            )

    def _script(self, root: Path, arguments: Sequence[str], variables: Mapping[str, str]) -> str:
        exported = {
            "PATH": debian.search_path(),
            "LD_LIBRARY_PATH": debian.library_path(),
            "LC_ALL": "C.UTF-8",
            REPORTS: str(self._reports),
            **{name: value for name, value in os.environ.items() if name.startswith("STATION_")},
            **variables,
        }
        lines = ["#!/bin/sh", *(f"export {name}={shlex.quote(value)}" for name, value in exported.items())]
        lines += [self.way.before, "ip link set lo up", f"cd {shlex.quote(str(root))}", shlex.join(arguments)]
        return "\n".join([*lines, self.way.after, ""])

    def reports(self) -> Iterator[dict[str, Any]]:
        """Reports in the order in which the inner pytest wrote them, until it ends or falls silent."""
        heard = time.monotonic()
        with self._reports.open("rb") as lines:
            while True:
                ended = self._process.poll() is not None
                line = lines.readline()
                if line.endswith(b"\n"):
                    heard = time.monotonic()
                    yield json.loads(line)
                elif ended or time.monotonic() - heard > SILENCE_LIMIT_S:
                    return
                else:
                    lines.seek(-len(line), os.SEEK_CUR)
                    time.sleep(_POLL_S)

    def last_words(self, lines: int = 60) -> str:
        """The end of the console, for the message of a test that never reported."""
        return "\n".join(self.console.read_text(errors="replace").splitlines()[-lines:])

    def stop(self, patience_s: float = 5.0) -> None:
        """Ends the job and everything that it started, after leaving it a moment to end by itself."""
        try:
            self._process.wait(timeout=patience_s)
        except subprocess.TimeoutExpired:
            # `timeout` passes this on to the guest, which left its group, and kills it if that does not help.
            self._process.terminate()
            self._process.wait(timeout=20)
