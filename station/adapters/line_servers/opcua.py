"""The station's outer state over OPC UA (asyncua): PackML's three state machines, status and times, Machinery's item
state and identification, and the units with their results by nest.

Types, names and node ids are those of OPC 30050 and OPC 40001-1, as far as the station uses them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any

from station.adapters.line_servers import companion_types as types
from station.adapters.line_servers.companion_space import add_companion_types, add_variable, node_id, opc_ua
from station.adapters.line_servers.facts import LineFacts
from station.adapters.line_servers.serving import ServedLine
from station.domain.cell.packml import Command, State
from station.errors import ConfigError

NAMESPACE = "urn:can-calibration-station:line"
MANUFACTURER = "CAN calibration station"
#: So often the nodes follow the line's word, s.
INTERVAL_S = 0.2
ITEM_STATES = ("NotAvailable", "OutOfService", "NotExecuting", "Executing")
#: PackML's machines, outer one first, by their way from the PackML object.
MACHINES = (
    (("BaseStateMachine",), types.BASE_MACHINE),
    (("BaseStateMachine", "MachineState"), types.MACHINE_MACHINE),
    (("BaseStateMachine", "MachineState", "ExecuteState"), types.EXECUTE_MACHINE),
)
_TEXTS = ("Serial", "Result")
#: Nodes of the base namespace.
_ORGANIZES, _HAS_COMPONENT, _HAS_ADD_IN = 35, 47, 17604


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
    space = _Space(server, await server.register_namespace(NAMESPACE), await add_companion_types(server))
    await space.build(line.facts(), line.send)
    async with server:
        line.ready(endpoint)
        while True:
            await space.follow(line.facts())
            await asyncio.sleep(INTERVAL_S)


class _Space:
    """The station among the server's objects. nodes: what is written, by name; nests as `Nests/A/Serial`."""

    def __init__(self, server: Any, own: int, spaces: Mapping[str, int]) -> None:
        self._server, self._own, self._spaces = server, own, spaces
        self._nodes: dict[str, Any] = {}

    async def build(self, facts: LineFacts, send: Callable[[Command], None]) -> None:
        """Every node, once."""
        root = await self._server.nodes.objects.add_object(self._own, "CalibrationStation")
        await self._add_packml(root, send)
        await self._add_machinery(root)
        status = await root.add_object(self._own, "Status")
        for name, value in (("Recipe", ""), ("Load", 0), ("LoadsDone", 0), ("Why", "")):
            self._nodes[name] = await status.add_variable(self._own, name, value)
        seats = await root.add_object(self._own, "Nests")
        for nest, _, _ in facts.nests:
            folder = await seats.add_object(self._own, nest)
            for name in _TEXTS:
                self._nodes[f"Nests/{nest}/{name}"] = await folder.add_variable(self._own, name, "")

    async def _add_packml(self, root: Any, send: Callable[[Command], None]) -> None:
        ua = opc_ua()
        index = self._spaces[types.PACKML]
        machine = await self._add(root, "PackML", types.BASE_OBJECT_TYPE, self._own)
        for name in ("PackMLVersion", "TagID"):
            self._nodes[name] = await machine.add_property(self._own, name, "")
            await self._nodes[name].write_attribute(
                ua.AttributeIds.BrowseName, ua.DataValue(ua.Variant(ua.QualifiedName(name, index)))
            )
        await self._nodes["PackMLVersion"].write_value(types.PACKML_VERSION)
        for way, kind in MACHINES:
            found = await machine.get_child([ua.QualifiedName(name, index) for name in way])
            current = await found.get_child("0:CurrentState")
            self._nodes[way[-1]], self._nodes[f"{way[-1]}/Id"] = current, await current.get_child("0:Id")
            for name in kind.methods:
                command = Command.COMPLETE if name == "ToComplete" else Command[name.upper()]
                node = ua.NodeId("/".join((*way, name)), self._own)
                await found.add_method(node, ua.QualifiedName(name, index), _method(command, send), [], [])
        for name in ("EquipmentBlocked", "EquipmentStarved", "UnitModeCurrent", "UnitSupportedModes"):
            self._nodes[name] = await machine.get_child([f"{index}:Status", f"{index}:{name}"])
        for name in ("CurMachSpeed", "MachSpeed"):
            node = await machine.get_child([f"{index}:Status", f"{index}:{name}"])
            unsupported = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadNotSupported))
            await node.write_value(unsupported)
        mode = ua.Variant(types.PRODUCE, ua.VariantType.Int32)
        await self._nodes["UnitModeCurrent"].write_value(mode)
        await self._nodes["UnitSupportedModes"].write_value(node_id(self._spaces, (types.PACKML, types.MODE_ENUM)))
        admin = await machine.get_child(f"{index}:Admin")
        for given in types.ADMIN.variables:
            node, browse = ua.NodeId(f"Admin/{given.name}", self._own), ua.QualifiedName(given.name, index)
            self._nodes[given.name] = await add_variable(admin, node, browse, given)
        await self._list(types.PACKML, types.PACKML_OBJECTS, "PackMLObjects", machine)

    async def _add_machinery(self, root: Any) -> None:
        ua = opc_ua()
        machinery, di = self._spaces[types.MACHINERY], self._spaces[types.DI]
        name = ua.QualifiedName("MachineryBuildingBlocks", machinery)
        blocks = await root.add_folder(ua.NodeId("MachineryBuildingBlocks", self._own), name)
        item = await self._add(blocks, "MachineryItemState", types.ITEM_MACHINE, machinery, _HAS_ADD_IN)
        current = await item.get_child("0:CurrentState")
        self._nodes["MachineryItemState"] = current
        self._nodes["MachineryItemState/Id"] = await current.get_child("0:Id")
        plate = await self._add(blocks, "Identification", types.IDENTIFICATION, di, _HAS_ADD_IN)
        for name in ("Manufacturer", "SerialNumber", "ProductInstanceUri"):
            self._nodes[name] = await plate.get_child(f"{di}:{name}")
        await self._nodes["Manufacturer"].write_value(ua.LocalizedText(MANUFACTURER))
        await self._list(types.MACHINERY, types.MACHINES, "Machines", root)

    async def _add(
        self, parent: Any, name: str, kind: types.CompanionType, space: int, reference: int = _HAS_COMPONENT
    ) -> Any:
        """An instance with what its type makes mandatory."""
        ua = opc_ua()
        of = node_id(self._spaces, (kind.namespace, kind.node))
        browse = ua.QualifiedName(name, space)
        added = await parent.add_object(ua.NodeId(name, self._own), browse, of, instantiate_optional=False)
        if reference == _HAS_ADD_IN:  # a folder organizes what is added to it
            await parent.delete_reference(added, _ORGANIZES)
            await parent.add_reference(added, reference)
        return added

    async def _list(self, namespace: str, node: int, name: str, entry: Any) -> None:
        """The folder of the specification in which clients look for such objects."""
        ua = opc_ua()
        index = self._spaces[namespace]
        folder = await self._server.nodes.objects.add_folder(ua.NodeId(node, index), ua.QualifiedName(name, index))
        await folder.add_reference(entry, _ORGANIZES)

    async def follow(self, facts: LineFacts) -> None:
        """Writes what the line says now."""
        ua = opc_ua()
        for (way, kind), name in zip(MACHINES, machine_states(facts.state), strict=True):
            await self._set_state(way[-1], kind, name)
        await self._set_state("MachineryItemState", types.ITEM_MACHINE, ITEM_STATES[facts.item_state])
        values: dict[str, Any] = {
            "Why": facts.why,
            "Recipe": facts.recipe,
            "Load": facts.load,
            "LoadsDone": facts.loads,
            "TagID": facts.station,
            "SerialNumber": facts.station,
            "ProductInstanceUri": f"urn:can-calibration-station:{facts.station}",
            "EquipmentStarved": facts.state is State.SUSPENDED,
        }
        for nest, serial, outcome in facts.nests:
            values |= {f"Nests/{nest}/Serial": serial, f"Nests/{nest}/Result": outcome}
        for name, value in values.items():
            if name in self._nodes:
                await self._nodes[name].write_value(value)
        seconds = [round(facts.seconds.get(state.label, 0.0)) for state in State]
        times = [[0] * (len(State) + 1), [0, *seconds]]  # by mode and state: mode 1 produces, both count from 0
        await self._nodes["AccTimeSinceReset"].write_value(ua.Variant(sum(seconds), ua.VariantType.Int32))
        await self._nodes["StateCumulativeTime"].write_value(ua.Variant(times, ua.VariantType.Int32))

    async def _set_state(self, name: str, kind: types.CompanionType, state: str) -> None:
        """Current state and its node of one machine; '' where its outer machine is in another state."""
        ua = opc_ua()
        text = state or "NotAvailable"
        known = (kind.namespace, kind.states[state][0]) if state in kind.states else None
        await self._nodes[name].write_value(ua.LocalizedText(text))
        await self._nodes[f"{name}/Id"].write_value(ua.NodeId() if known is None else node_id(self._spaces, known))


def machine_states(state: State | None) -> tuple[str, str, str]:
    """The states of PackML's three nested machines, outer one first; '' where a machine is not in use."""
    if state is None:
        return "", "", ""
    name = state.label.capitalize()
    if name in types.BASE_MACHINE.states:
        return name, "", ""
    if name in types.MACHINE_MACHINE.states:
        return "Cleared", name, ""
    return "Cleared", "Running", name


def _method(command: Command, send: Callable[[Command], None]) -> Any:
    from asyncua.common.methods import uamethod

    @uamethod
    def call(_parent: Any) -> None:
        send(command)

    return call
