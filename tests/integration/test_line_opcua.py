"""The line over OPC UA, as a client (asyncua) sees it: names and numbers are those of PackML and Machinery."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import pytest

from station.adapters.line_servers.asyncua_types import opc_ua
from station.adapters.line_servers.facts import LineFacts, facts_of
from station.adapters.line_servers.opcua import serve_opcua
from station.adapters.line_servers.serving import ServedLine
from station.domain.cell.adjustment import LineAdjustment, UnitMode
from station.domain.cell.packml import Command
from tests.fakes.serving import free_port, served

_Found = TypeVar("_Found")

HELD = {
    "state": 11, "station": "s", "recipe": "r/1", "load": 7, "loads": 3, "seconds": {"execute": 9.0},
    "nests": [{"nest": "A", "serial": "SN1", "outcome": "FAIL"}], "mode": 1,
    "times_s": {"starved_s": 5.0, "scan_s": 4.0}, "ideal_s": 36.0, "units_per_hour": 80.0,
    "units": {"good": [3, 30], "reject": [1, 4], "again": [0, 1]},
    "stop_reasons": [
        {"why": {"id": "printer-paper"}, "state": 10, "began_s": 2000.0, "ended_s": None},
        {"why": {"id": "line-starved"}, "state": 13, "began_s": 1000.0, "ended_s": 1500.0},
    ],
}  # fmt: skip
#: What OPC 30050 makes mandatory on PackMLBaseObjectType and the types of its parts.
_MACHINE = ("0:AvailableStates", "0:AvailableTransitions", "0:CurrentState", "0:CurrentState/0:Id")
MANDATORY = (
    *(["SetUnitMode", "SetMachSpeed", "SetProduct", "SetParameter"]),
    *(f"{name}/0:InputArguments" for name in ("SetUnitMode", "SetMachSpeed", "SetProduct", "SetParameter")),
    "Admin", "Status/CurMachSpeed", "Status/CurMachSpeed/0:EURange", "Status/MachSpeed", "Status/MachSpeed/0:EURange",
    "Status/EquipmentBlocked", "Status/EquipmentStarved", "Status/UnitModeCurrent", "Status/UnitSupportedModes",
    *(f"BaseStateMachine/{name}" for name in _MACHINE),
    *(f"BaseStateMachine/MachineState/{name}" for name in _MACHINE),
    *(f"BaseStateMachine/MachineState/ExecuteState/{name}" for name in _MACHINE),
)  # fmt: skip


@dataclass(slots=True)
class ServedFacts:
    """A server over facts that a test may change."""

    facts: LineFacts
    port: int = 0
    sent: list[Command] = field(default_factory=list)
    adjusted: list[LineAdjustment] = field(default_factory=list)

    def look(self, what: Callable[[Any, Any, int], Awaitable[_Found]]) -> _Found:
        """What a client finds. what: is given the client, the PackML object and the index of its namespace."""

        from asyncua.client.client import Client

        async def run() -> _Found:
            async with Client(f"opc.tcp://127.0.0.1:{self.port}") as client:
                index = await client.get_namespace_index("http://opcfoundation.org/UA/PackML/")
                (packml,) = await client.get_node(f"ns={index};i=72").get_children()
                await client.load_data_type_definitions()
                return await what(client, packml, index)

        return asyncio.run(run())


@pytest.fixture(scope="module")
def server() -> Iterator[ServedFacts]:
    line = ServedFacts(facts_of(HELD, "Look at it.", alive=True))

    async def serve(ready: Callable[[int], None]) -> None:
        port = free_port()
        given = ServedLine(
            "127.0.0.1", port, lambda: line.facts, line.sent.append, lambda _: ready(port), line.adjusted.append
        )
        await serve_opcua(given)

    with served(serve) as line.port:
        yield line


@pytest.fixture
def line(server: ServedFacts) -> ServedFacts:
    server.facts = facts_of(HELD, "Look at it.", alive=True)
    server.sent.clear()
    server.adjusted.clear()
    return server


def path(text: str, index: int) -> list[str]:
    return [part if ":" in part else f"{index}:{part}" for part in text.split("/")]


async def value(packml: Any, text: str, index: int) -> Any:
    return await (await packml.get_child(path(text, index))).read_value()


def test_every_mandatory_member_is_there(line: ServedFacts) -> None:
    async def look(_client: Any, packml: Any, index: int) -> list[str]:
        missing = []
        for member in MANDATORY:
            try:
                await packml.get_child(path(member, index))
            except opc_ua().UaStatusCodeError:
                missing.append(member)
        return missing

    assert line.look(look) == []


def test_states_units_and_results(line: ServedFacts) -> None:
    async def look(client: Any, packml: Any, index: int) -> dict[str, Any]:
        uris = [f"http://opcfoundation.org/UA/{name}/" for name in ("Machinery", "DI")]
        machinery, di = [await client.get_namespace_index(uri) for uri in uris]
        root = await client.nodes.objects.get_child(["2:CalibrationStation"])
        assert root in await client.get_node(f"ns={machinery};i=1001").get_children()
        assert (await packml.read_type_definition()).Identifier == 6
        base = await packml.get_child(f"{index}:BaseStateMachine")
        inner = await base.get_child(path("MachineState/ExecuteState", index))
        async with asyncio.timeout(5):  # until the facts are served
            while (await (await base.get_child("0:CurrentState")).read_value()).Text != "Cleared":
                await asyncio.sleep(0.02)
        item = await root.get_child([f"{machinery}:MachineryBuildingBlocks", f"{machinery}:MachineryItemState"])
        found: dict[str, Any] = {}
        for name, machine in (("base", base), ("state", inner), ("item", item)):
            current = await machine.get_child("0:CurrentState")
            held = client.get_node(await (await current.get_child("0:Id")).read_value())
            number = await (await held.get_child("0:StateNumber")).read_value()
            found[name] = (await current.read_value()).Text, held.nodeid.Identifier, number
        paths = {
            "why": ["2:Status", "2:Why"],
            "serial": ["2:Nests", "2:A", "2:Serial"],
            "result": ["2:Nests", "2:A", "2:Result"],
            "station": [f"{machinery}:MachineryBuildingBlocks", f"{di}:Identification", f"{di}:SerialNumber"],
        }
        return found | {name: await (await root.get_child(way)).read_value() for name, way in paths.items()}

    assert line.look(look) == {
        "base": ("Cleared", 71, 19),
        "state": ("Held", 34, 11),
        "item": ("NotExecuting", 5007, 2),
        "why": "Look at it.",
        "serial": "SN1",
        "result": "FAIL",
        "station": "s",
    }


def test_counts_times_alarms_and_speeds(line: ServedFacts) -> None:
    async def look(_client: Any, packml: Any, index: int) -> dict[str, Any]:
        async with asyncio.timeout(5):
            while not await value(packml, "Admin/Alarm", index):
                await asyncio.sleep(0.02)
        names = ("ProdProcessedCount", "ProdDefectiveCount", "Parameter", "Alarm", "AlarmHistory", "StopReason")
        found = {name: await value(packml, f"Admin/{name}", index) for name in names}
        return found | {name: await value(packml, f"Status/{name}", index) for name in ("CurMachSpeed", "MachSpeed")}

    found = line.look(look)
    assert [(c.Name, c.Count, c.AccCount) for c in found["ProdProcessedCount"]] == [("units", 4, 35)]
    assert [(c.Name, c.Count, c.AccCount) for c in found["ProdDefectiveCount"]] == [("reject", 1, 4), ("again", 0, 1)]
    assert [(p.ID, p.Name, p.Value) for p in found["Parameter"]] == [(1, "starved_s", 5.0), (2, "scan_s", 4.0)]
    assert [(a.Message, a.Trigger) for a in found["Alarm"]] == [(found["StopReason"].Message, True)]
    assert found["StopReason"].Message.startswith("The label printer is out of labels")
    assert [(a.Trigger, a.AckDateTime.timestamp()) for a in found["AlarmHistory"]] == [(False, 1500.0)]
    assert (found["CurMachSpeed"], found["MachSpeed"]) == (0.0, 100.0), "held: nothing is made"


def parameter(number: int, seconds: float, name: str = "") -> Any:
    made = opc_ua().PackMLDescriptorDataType()
    made.ID, made.Name, made.Value = number, name, seconds
    return made


def int32(number: int) -> Any:
    ua = opc_ua()
    return ua.Variant(number, ua.VariantType.Int32)


def float32(number: float) -> Any:
    ua = opc_ua()
    return ua.Variant(number, ua.VariantType.Float)


def structures(*values: Any) -> Any:
    ua = opc_ua()
    return ua.Variant(list(values), ua.VariantType.ExtensionObject, is_array=True)


def test_methods_change_the_line(line: ServedFacts) -> None:
    async def look(_client: Any, packml: Any, index: int) -> None:
        inner = await packml.get_child(path("BaseStateMachine/MachineState/ExecuteState", index))
        await inner.call_method(f"{index}:Unhold")
        await packml.call_method(f"{index}:SetParameter", structures(parameter(1, 12.0), parameter(2, 2.5, "scan_s")))
        line.facts = facts_of(HELD | {"state": 2}, "", alive=True)
        await packml.call_method(f"{index}:SetUnitMode", int32(2))
        line.facts = facts_of(HELD | {"state": 4}, "", alive=True)
        await inner.call_method(f"{index}:Start", structures(parameter(2, 3.0)))

    line.look(look)
    assert line.sent == [Command.UNHOLD, Command.START]
    assert line.adjusted == [
        LineAdjustment(UnitMode.PRODUCE, {"starved_s": 12.0, "scan_s": 2.5}),
        LineAdjustment(UnitMode.MAINTENANCE, {"starved_s": 5.0, "scan_s": 4.0}),
        LineAdjustment(UnitMode.PRODUCE, {"starved_s": 5.0, "scan_s": 3.0}),
    ]


#: Method, argument, the line's document beyond HELD, the status, and a word of the reason.
REFUSED: tuple[tuple[str, Callable[[], tuple[Any, ...]], dict[str, Any], str, str], ...] = (
    ("SetUnitMode", lambda: (int32(2),), {}, "BadInvalidState", "stop the line first"),
    ("SetUnitMode", lambda: (int32(3),), {"state": 2}, "BadNotSupported", "1 produce"),
    ("SetUnitMode", lambda: ("maintenance",), {"state": 2}, "BadInvalidArgument", "Int32"),
    ("SetUnitMode", tuple, {"state": 2}, "BadArgumentsMissing", "takes 1"),
    (
        "SetMachSpeed",
        lambda: (float32(50.0),),
        {},
        "BadNotSupported",
        "sets the pace",
    ),
    ("SetProduct", lambda: (structures(),), {}, "BadNotSupported", "recipe r/1"),
    ("SetParameter", lambda: (structures(parameter(9, 1.0)),), {}, "BadInvalidArgument", "1 starved_s"),
    ("SetParameter", lambda: (structures(parameter(1, 1.0, "scan_s")),), {}, "BadInvalidArgument", "scan_s"),
    ("SetParameter", lambda: (structures(parameter(1, 1e9)),), {}, "BadOutOfRange", "0 to 3600 s"),
    ("SetParameter", lambda: (structures(parameter(1, float("nan"))),), {}, "BadOutOfRange", "nan"),
    ("BaseStateMachine/Clear", tuple, {}, "BadInvalidState", "held"),
    ("BaseStateMachine/MachineState/ExecuteState/Hold", tuple, {"state": 9}, "BadStateNotActive", "aborted"),
    ("BaseStateMachine/MachineState/Reset", tuple, {"state": 2, "mode": 2}, "BadInvalidState", "maintenance"),
)


def test_what_cannot_be_followed_is_refused_with_its_reason(line: ServedFacts) -> None:
    async def look(client: Any, packml: Any, index: int) -> list[tuple[str, str]]:
        refusal = await client.nodes.objects.get_child(["2:CalibrationStation", "2:Status", "2:Refusal"])
        found = []
        for method, arguments, document, _, word in REFUSED:
            line.facts = facts_of(HELD | document, "", alive=True)
            *way, name = path(method, index)
            with pytest.raises(opc_ua().UaStatusCodeError) as refused:
                await (await packml.get_child(way) if way else packml).call_method(name, *arguments())
            async with asyncio.timeout(5):
                while word not in await refusal.read_value():
                    await asyncio.sleep(0.02)
            found.append((method, type(refused.value).__name__))
        return found

    assert line.look(look) == [(method, status) for method, _, _, status, _ in REFUSED]
    assert (line.sent, line.adjusted) == ([], [])


def test_no_line_takes_no_method(line: ServedFacts) -> None:
    async def look(_client: Any, packml: Any, index: int) -> None:
        line.facts = facts_of(None, "", alive=False)
        base = await packml.get_child(f"{index}:BaseStateMachine")
        await base.call_method(f"{index}:Abort")

    with pytest.raises(opc_ua().UaStatusCodeError, match="BadOutOfService"):
        line.look(look)
    assert line.sent == []
