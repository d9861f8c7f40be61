"""The station's outer state over Modbus TCP, for a line controller (pymodbus). docs/line.md lists the registers."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING

from station.adapters.line_servers.facts import OUTCOME_CODES, LineFacts
from station.adapters.line_servers.serving import ServedLine
from station.domain.cell.packml import Command, State
from station.errors import ConfigError

if TYPE_CHECKING:
    from pymodbus.constants import ExcCodes

PROTOCOL = 1
#: Registers: state block, nests from 20 on, seconds of the states from 40 on (two words each), commands from 100 on.
NESTS_AT, SECONDS_AT, COMMAND_AT, NUMBER_AT, ECHO_AT, SIZE = 20, 40, 100, 101, 102, 120
MOST_NESTS = 16


def words_of_line(facts: LineFacts, heartbeat: int) -> dict[int, int]:
    """Registers 0 to 99: protocol, heartbeat, state (0: no line runs), item state, load, loads, nests, seconds."""
    words = {0: PROTOCOL, 1: heartbeat % 65536, 2: int(facts.state or 0), 3: facts.item_state}
    words |= _long(4, facts.load) | _long(6, facts.loads)
    for place, (_, serial, outcome) in enumerate(facts.nests[:MOST_NESTS]):
        words[NESTS_AT + place] = OUTCOME_CODES.get(outcome, 3) | (0x100 if serial else 0)
    for state in State:
        words |= _long(SECONDS_AT + 2 * (state - 1), int(facts.seconds.get(state.label, 0.0)))
    return words


def _long(at: int, value: int) -> dict[int, int]:
    return {at: value >> 16 & 0xFFFF, at + 1: value & 0xFFFF}


async def serve_modbus(line: ServedLine) -> None:
    """Serves registers in a loop of asyncio. Errors: OSError where it cannot listen, ConfigError without pymodbus."""
    try:
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice
    except ImportError:
        raise ConfigError("extra-missing", package="pymodbus", extra="line") from None
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    last = 0

    async def action(
        _code: int, start: int, address: int, count: int, registers: list[int], values: list[int] | list[bool] | None
    ) -> ExcCodes | None:
        from pymodbus.constants import ExcCodes

        nonlocal last
        if values is None:
            for at, word in words_of_line(line.facts(), int(time.monotonic() * 10)).items():
                registers[at - start] = word
            registers[ECHO_AT - start] = last
            return None
        if not COMMAND_AT <= address <= address + count - 1 <= NUMBER_AT:
            return ExcCodes.ILLEGAL_ADDRESS  # everything else is the station's own
        words = dict(enumerate(map(int, values), address))
        number, command = words.get(NUMBER_AT, last), words.get(COMMAND_AT, registers[COMMAND_AT - start])
        if number != last:  # a repeated request with the same number is the same command
            if command not in set(Command):
                return ExcCodes.ILLEGAL_VALUE
            last = number
            line.send(Command(command))
        return None

    device = SimDevice(id=0, simdata=[SimData(0, count=SIZE, values=0, datatype=DataType.REGISTERS)], action=action)
    server = ModbusTcpServer(device, address=(line.host, line.port))
    if not await server.listen():
        raise OSError(98, "address in use")
    line.ready(f"modbus://{line.host}:{line.port}")
    await server.serving
