"""The station's outer state over OPC UA (asyncua): PackML's states and Machinery's item state, unit and result by nest.

The names are those of OPC 30050 and OPC 40001-1; the companion specifications' own node sets are not shipped.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from station.adapters.line_servers.facts import LineFacts
from station.adapters.line_servers.serving import ServedLine
from station.domain.cell.packml import Command
from station.errors import ConfigError

NAMESPACE = "urn:can-calibration-station:line"
#: So often the nodes follow the line's word, s.
INTERVAL_S = 0.2
ITEM_STATES = ("NotAvailable", "OutOfService", "NotExecuting", "Executing")
_TEXTS = ("Serial", "Result")


async def serve_opcua(line: ServedLine) -> None:
    """Serves nodes in a loop of asyncio. Errors: OSError where it cannot listen, ConfigError without asyncua."""
    endpoint = f"opc.tcp://{line.host}:{line.port}"
    try:
        from asyncua import ua
        from asyncua.server.server import Server
    except ImportError:
        raise ConfigError("extra-missing", package="asyncua", extra="line") from None
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    server = Server()
    await server.init()
    server.set_endpoint(endpoint)
    server.set_server_name("CAN calibration station")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    space = await server.register_namespace(NAMESPACE)
    nodes = await _build(server, space, line.facts(), line.send)
    async with server:
        line.ready(endpoint)
        while True:
            await _follow(nodes, line.facts())
            await asyncio.sleep(INTERVAL_S)


async def _build(server: Any, space: int, facts: LineFacts, send: Callable[[Command], None]) -> dict[str, Any]:
    """The nodes by name; values of nests as `Nests/A/Serial`."""
    root = await server.nodes.objects.add_object(space, "CalibrationStation")
    nodes: dict[str, Any] = {}
    machine = await root.add_object(space, "PackMLBaseStateMachine")
    for name, start in (("CurrentState", "NotAvailable"), ("CurrentStateNumber", 0), ("Why", "")):
        nodes[name] = await machine.add_variable(space, name, start)
    for command in Command:
        await machine.add_method(space, command.label.capitalize(), _method(command, send), [], [])
    item = await root.add_object(space, "MachineryBuildingBlocks")
    for name, start in (("MachineryItemState", "NotAvailable"), ("MachineryItemStateNumber", 0)):
        nodes[name] = await item.add_variable(space, name, start)
    status = await root.add_object(space, "Status")
    for name, value in (("Recipe", ""), ("Load", 0), ("LoadsDone", 0)):
        nodes[name] = await status.add_variable(space, name, value)
    seats = await root.add_object(space, "Nests")
    for nest, _, _ in facts.nests:
        folder = await seats.add_object(space, nest)
        for name in _TEXTS:
            nodes[f"Nests/{nest}/{name}"] = await folder.add_variable(space, name, "")
    return nodes


def _method(command: Command, send: Callable[[Command], None]) -> Any:
    from asyncua.common.methods import uamethod

    @uamethod
    def call(_parent: Any) -> None:
        send(command)

    return call


async def _follow(nodes: dict[str, Any], facts: LineFacts) -> None:
    values: dict[str, Any] = {
        "CurrentState": facts.state.label.capitalize() if facts.state else "NotAvailable",
        "CurrentStateNumber": int(facts.state or 0),
        "Why": facts.why,
        "MachineryItemState": ITEM_STATES[facts.item_state],
        "MachineryItemStateNumber": facts.item_state,
        "Recipe": facts.recipe,
        "Load": facts.load,
        "LoadsDone": facts.loads,
    }
    for nest, serial, outcome in facts.nests:
        values |= {f"Nests/{nest}/Serial": serial, f"Nests/{nest}/Result": outcome}
    for name, value in values.items():
        if name in nodes:
            await nodes[name].write_value(value)
