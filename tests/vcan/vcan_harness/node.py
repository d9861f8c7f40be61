"""The independent CANopen peers: programs on Node, spoken to in lines of JSON."""

import json
import os
import select
import subprocess
import time
from collections.abc import Sequence
from typing import Any, Self

from vcan_harness import peers
from vcan_harness.debian import Unavailable
from vcan_harness.interface import Interface


class Refused(Exception):
    """The master's transfer failed. code: SDO abort code, or None."""

    def __init__(self, sentence: str, code: int | None) -> None:
        super().__init__(sentence)
        self.code = code


class Peer:
    """A running script of tests/vcan/peers. Every line it prints is an event."""

    def __init__(self, script: str, *arguments: str) -> None:
        missing = os.environ.get(peers.NODE_MISSING)
        if missing:
            raise Unavailable(missing)
        self._script = script
        self._process = subprocess.Popen(
            [os.environ[peers.NODE], str(peers.SCRIPTS / script), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._text = b""
        self.events: list[dict[str, Any]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        """Power off: no last words, what is not saved is lost."""
        self._process.kill()
        self._process.communicate()

    def say(self, message: dict[str, Any]) -> None:
        """Sends one line."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message).encode() + b"\n")
        self._process.stdin.flush()

    def hear(self, timeout_s: float = 30.0) -> dict[str, Any]:
        """The next event. Errors: TimeoutError when none comes, EOFError when the program has ended."""
        assert self._process.stdout is not None
        deadline = time.monotonic() + timeout_s
        while b"\n" not in self._text:
            ready, _, _ = select.select([self._process.stdout], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                raise TimeoutError(f"{self._script}: no event within {timeout_s:g} s; had {self.events}")
            piece = os.read(self._process.stdout.fileno(), 65536)
            if not piece:
                raise EOFError(f"{self._script} has ended, exit code {self._process.wait()}")
            self._text += piece
        line, self._text = self._text.split(b"\n", 1)
        event: dict[str, Any] = json.loads(line)
        self.events.append(event)
        return event

    def wait_for(self, name: str, timeout_s: float = 30.0) -> dict[str, Any]:
        """Reads events until one of this name."""
        deadline = time.monotonic() + timeout_s
        while (event := self.hear(max(0.0, deadline - time.monotonic())))["event"] != name:
            pass
        return event


class NodeDevice(Peer):
    """peers/device.js on an interface; `options` as listed in README.md. Ready when the constructor returns."""

    def __init__(self, interface: Interface, **options: Any) -> None:
        super().__init__("device.js", interface.name, json.dumps(options))
        self.node = int(options.get("node", 1))
        self.wait_for("ready")

    def turn(self, true_g: Sequence[float]) -> None:
        """Turns the device: the vector it feels, in its own frame."""
        self._order("turn", true_g=list(true_g))

    def warm(self, temperature_degC: float) -> None:
        """Sets its temperature."""
        self._order("warm", temperature_degC=temperature_degC)

    def fault(self, **faults: Any) -> None:
        """Sets all faults anew: silent, refuse={index: abort code}, late_ms, twice; without arguments it is well."""
        self._order("fault", **faults)

    def reboot(self) -> None:
        """Resets itself, as a watchdog would."""
        self._order("reboot")

    def _order(self, order: str, **values: Any) -> None:
        self.say({"order": order, **values})
        self.wait_for("done")


class NodeMaster(Peer):
    """peers/master.js on an interface."""

    def __init__(self, interface: Interface) -> None:
        super().__init__("master.js", interface.name)
        self.hear()

    def upload(self, node: int, index: int, sub: int = 0, *, block: bool = False) -> bytes:
        """Raw value of an object. Errors: Refused."""
        return self._request(do="upload", node=node, index=index, sub=sub, block=block)

    def download(self, node: int, index: int, sub: int, data: bytes, *, block: bool = False) -> None:
        """Writes an object. Errors: Refused."""
        self._request(do="download", node=node, index=index, sub=sub, data=data.hex(), block=block)

    def nmt(self, node: int, command: str) -> None:
        """start, stop, pre-operational, reset-node or reset-communication."""
        self._request(do="nmt", node=node, command=command)

    def _request(self, **request: Any) -> bytes:
        self.say(request)
        answer = self.hear()
        if "error" in answer:
            raise Refused(answer["error"], answer.get("code"))
        return bytes.fromhex(answer["data"])
