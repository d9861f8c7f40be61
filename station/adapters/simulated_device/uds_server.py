"""A UDS server over a simulated device's objects (ISO 14229-1), written from the standard's bytes."""

import os
from collections.abc import Callable

from station.adapters.simulated_device.object_server import SdoRequest
from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.sdo_serving import SdoAbort
from station.domain.product.access import UdsAccess
from station.domain.product.object_dictionary import TYPES, Address
from station.domain.product.uds_codes import IDENTITY, data_identifier
from station.domain.product.writeback import LOAD, SAVE

SeedKey = Callable[[int, bytes], bytes]
READ, WRITE, SESSION, SECURITY, ROUTINE, RESET, PRESENT = 0x22, 0x2E, 0x10, 0x27, 0x31, 0x11, 0x3E
_NEGATIVE, _POSITIVE = 0x7F, 0x40
_DEFAULT_SESSION = 0x01
#: SDO abort code → negative response code; what is not here is out of range.
_CODES = {
    0x08000000: 0x10,
    0x06060000: 0x72,
    0x06070012: 0x13,
    0x06070013: 0x13,
    0x08000022: 0x22,
    0x08000020: 0x22,
    0x05040001: 0x11,
}
_SEED_BYTES = 4


class UdsServer:
    """key: makes the key of a level from its seed; None where nothing is locked."""

    def __init__(self, objects: SimulatedObjects, access: UdsAccess, key: SeedKey | None) -> None:
        self._objects, self._access, self._key = objects, access, key
        self._at = _addresses(objects)
        self._current = (0, (0, 0))
        self.reset()

    def reset(self) -> None:
        """Default session, locked."""
        self._session, self._unlocked, self._seed, self._restart = _DEFAULT_SESSION, False, b"", False

    def wants_restart(self) -> bool:
        """Whether the last request was an ECU reset."""
        requested, self._restart = self._restart, False
        return requested

    def about(self, data: bytes) -> SdoRequest:
        """What a request is about; one without an object is about none."""
        service, at = data[0], self._address(data)
        return SdoRequest(*at, "read" if service == READ else "write", starts=True, segment=False)

    def handle(self, data: bytes) -> tuple[bytes, ...]:
        """The answer to one request."""
        self._current = (data[0], self._address(data))
        services: dict[int, Callable[[bytes], bytes]] = {
            READ: self._read,
            WRITE: self._write,
            SESSION: self._change_session,
            SECURITY: self._give_access,
            ROUTINE: self._start_routine,
            RESET: self._reset_device,
            PRESENT: lambda request: request[1:2],
        }
        serve = services.get(data[0])
        if serve is None:
            return (bytes([_NEGATIVE, data[0], 0x11]),)
        try:
            return (bytes([data[0] + _POSITIVE]) + serve(data),)
        except SdoAbort as abort:
            return (self.abort(abort.code),)
        except _Negative as negative:
            return (bytes([_NEGATIVE, data[0], negative.code]),)

    def refuse(self, data: bytes, code: int) -> bytes:
        """A negative response to a request that is not served."""
        self._current = (data[0], self._address(data))
        return self.abort(code)

    def abort(self, code: int) -> bytes:
        """A negative response to the last request."""
        return bytes([_NEGATIVE, self._current[0], _CODES.get(code, 0x31)])

    def of_other_object(self, answer: bytes, index: int) -> bytes:
        """The same answer under another data identifier."""
        if answer[0] - _POSITIVE not in (READ, WRITE):
            return answer
        return answer[:1] + (index & 0xFFFF).to_bytes(2, "big") + answer[3:]

    def of_next_object(self, answer: bytes) -> bytes:
        """The same answer under the next data identifier."""
        return self.of_other_object(answer, int.from_bytes(answer[1:3], "big") + 1)

    def _address(self, data: bytes) -> Address:
        if data[0] in (READ, WRITE) and len(data) >= 3:
            return self._at.get(int.from_bytes(data[1:3], "big"), (0, 0))
        if data[0] == ROUTINE and len(data) >= 4:
            number = int.from_bytes(data[2:4], "big")
            return next((at for at in self._commands() if sum(at) == number), (0, 0))
        return 0, 0

    def _read(self, data: bytes) -> bytes:
        at = self._known(data)
        return data[1:3] + self._turned(at, self._objects.read(*at))

    def _write(self, data: bytes) -> bytes:
        self._must_be_open()
        at = self._known(data)
        value = self._turned(at, data[3:])
        self._objects.check(*at, len(value))
        self._objects.write(*at, value)
        return data[1:3]

    def _known(self, data: bytes) -> Address:
        if len(data) < 3:
            raise _Negative(0x13)
        if int.from_bytes(data[1:3], "big") not in self._at:
            raise _Negative(0x31)
        return self._current[1]

    def _turned(self, at: Address, raw: bytes) -> bytes:
        is_number = bool(TYPES[self._objects.dictionary[at].type][1])
        return raw[::-1] if is_number and self._access.byte_order == "big" else raw

    def _must_be_open(self) -> None:
        if self._session != self._access.session:
            raise _Negative(0x7F)
        if self._key is not None and not self._unlocked:
            raise _Negative(0x33)

    def _change_session(self, data: bytes) -> bytes:
        self._session, self._unlocked = data[1], False
        return data[1:2] + bytes.fromhex("003201f4")

    def _give_access(self, data: bytes) -> bytes:
        level = 1 if self._access.security is None else self._access.security.level
        if data[1] == level:
            self._seed = bytes(_SEED_BYTES) if self._unlocked or self._key is None else os.urandom(_SEED_BYTES)
            return data[1:2] + self._seed
        if data[1] != level + 1:
            raise _Negative(0x12)
        if not self._seed:
            raise _Negative(0x24)
        if self._key is not None and data[2:] != self._key(level, self._seed):
            raise _Negative(0x35)
        self._unlocked, self._seed = True, b""
        return data[1:2]

    def _start_routine(self, data: bytes) -> bytes:
        self._must_be_open()
        if data[1] != 1:
            raise _Negative(0x12)
        at = self._current[1]
        if at not in self._commands():
            raise _Negative(0x31)
        self._objects.write(*at, self._commands()[at])
        return data[1:4]

    def _commands(self) -> dict[Address, bytes]:
        commands = ((self._objects.map.save, SAVE), (self._objects.map.restore, LOAD))
        return {command.address: signature for command, signature in commands if command is not None}

    def _reset_device(self, data: bytes) -> bytes:
        self._restart = True
        return data[1:2]


class _Negative(Exception):
    """A negative response."""

    def __init__(self, code: int) -> None:
        self.code = code


def _addresses(objects: SimulatedObjects) -> dict[int, Address]:
    """Data identifier → object, of every object that has one."""
    entries = objects.dictionary.entries
    found = {did: at for at in entries if (did := data_identifier(*at)) is not None}
    return {**found, **{did: at for at, did in IDENTITY.items() if at in entries}}
