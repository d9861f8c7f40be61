"""The line's devices on real sockets: PLC, scanners, printer, and the state as a line controller reads it."""

import asyncio
import json
import os
import pty
import sys
import threading
import tty
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient

from station.adapters.cell.plc import PlcCell
from station.adapters.cell.remote_io import RemoteIoCell
from station.adapters.clock import SystemClock
from station.adapters.label_printer.zpl import ZplPrinter
from station.adapters.line_servers.facts import facts_of
from station.adapters.line_servers.modbus import serve_modbus
from station.adapters.line_servers.serving import ServedLine
from station.adapters.modbus import ModbusRegisters
from station.adapters.positioner.plc import PlcPositioner
from station.adapters.scanner.keyboard import KeyboardScanner
from station.adapters.scanner.network import NetworkScanner
from station.adapters.scanner.serial_port import SerialPortScanner
from station.adapters.simulated_plc import CellLoads, SimulatedPlc, SimulatedRemoteIo, parse_fault
from station.adapters.simulated_plc.devices import serve_printer, serve_scanner
from station.adapters.simulated_plc.server import PlcServer
from station.domain.cell.handover import Bin
from station.domain.cell.packml import Command, State
from station.domain.cell.register_map import RegisterMap
from station.errors import PlcFault, PositionerFault, StationFault
from station.ports.cell import UnitLabel
from station.wiring.rig_machines import wiring_of
from tests.fakes.plc_faults import stop
from tests.fakes.serving import free_port, served
from tests.fakes.waiting import until


def plc_on_a_socket(plc: SimulatedPlc) -> Any:
    return served(lambda ready: PlcServer(plc).serve("127.0.0.1", 0, ready))


def positioner(port: int) -> PlcPositioner:
    settings = PlcPositioner.Settings(host="127.0.0.1", port=port, answer_s=0.2, speed_deg_s=1000.0)
    return PlcPositioner(settings, SystemClock())


def test_a_plc_on_a_real_socket_turns_the_fixture() -> None:
    plc = SimulatedPlc(RegisterMap(), 2000.0, 20000.0)
    with plc_on_a_socket(plc) as port, closing(positioner(port)) as driven:
        driven.move(stop("+x"), 5.0)
        driven.move(stop("-z"), 5.0)
        driven.park(5.0)
    assert [m.number for m in plc.motions] == [1, 2, 3]


@pytest.mark.parametrize(
    ("fault", "id_"),
    [
        ("silent:at=1,after_s=0", "plc-lost"),
        ("killed:at=1,after_s=0", "plc-not-reached"),
        ("exception:at=1,after_s=0", "plc-exception"),
        ("garbage:at=1,after_s=0", "plc-lost"),
        ("late:at=1,after_s=0", "plc-lost"),
        ("dropped:at=1,after_s=0,seconds=0.2", ""),
    ],
)
def test_faults_of_a_real_wire(fault: str, id_: str) -> None:
    plc = SimulatedPlc(RegisterMap(), 120.0, faults=[parse_fault(fault)])
    with plc_on_a_socket(plc) as port, closing(positioner(port)) as driven:
        if not id_:
            driven.move(stop("+x"), 5.0)
            return
        with pytest.raises(PositionerFault) as found:
            driven.move(stop("+x"), 5.0)
        asyncio.run(asyncio.sleep(0.6))  # the PLC's own watch of the station
    assert found.value.message.id == id_
    assert len(plc.motions) == 1
    assert plc.motions[0].until_s - plc.motions[0].began_s < 0.9, "it stood when the station was gone"


def test_a_write_is_sent_once() -> None:
    requests: list[bytes] = []

    async def late(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with closing(writer):
            requests.append(await reader.read(1000))
            await asyncio.sleep(0.4)
            requests.append(await reader.read(1000))

    async def serve(ready: Callable[[int], None]) -> None:
        server = await asyncio.start_server(late, "127.0.0.1", 0)
        ready(server.sockets[0].getsockname()[1])
        async with server:
            await server.serve_forever()

    with served(serve) as port, pytest.raises(PlcFault, match=r"no answer within 0\.1 s"):
        ModbusRegisters("127.0.0.1", port, 1, 0.1).write(5, [1])
    assert len([r for r in requests if r]) == 1


def test_a_cell_without_a_plc_on_a_real_socket(tmp_path: Path) -> None:
    given = RemoteIoCell.Settings(
        host="127.0.0.1", parts=(0, 1), clamped=(4, 5), clamps=(0, 1), memory=str(tmp_path / "memory.json")
    )
    io = SimulatedRemoteIo(wiring_of(given, 2), iter([("SN1", "SN2")]), change_s=0.3)
    with served(lambda ready: PlcServer(io).serve("127.0.0.1", 0, ready)) as port:
        cell = RemoteIoCell(given.model_copy(update={"port": port}), SystemClock())
        cell.show(State.EXECUTE, frozenset({"green"}))
        until(lambda: cell.view().ready, "a load")
        cell.give(1, {0: Bin.GOOD, 1: Bin.REJECT})
        until(lambda: not cell.view().ready and len(io.taken) == 1, "the good unit is taken")
        until(lambda: cell.view().present == frozenset() and len(io.taken) == 2, "the reject is taken")
        assert io.lamps >= {"green"}
        cell.close()
    assert [(t.serial, t.acknowledged) for t in io.taken] == [("SN1", False), ("SN2", True)]


def test_a_load_through_a_plc_on_a_real_socket() -> None:
    loads = CellLoads(iter([("SN1", ""), ("SN2", "SN3")]), change_s=0.05)
    plc = SimulatedPlc(RegisterMap(), loads=loads, nests=2)
    with plc_on_a_socket(plc) as port:
        cell = PlcCell(PlcCell.Settings(host="127.0.0.1", port=port), SystemClock())
        view = cell.view()
        assert (view.load, view.ready, view.present) == (1, True, frozenset({0}))
        cell.accept(1)
        cell.give(1, {0: 1, 1: 1})  # a bin for an empty nest: the clamps stay closed
        assert cell.view().taken == 0
        cell.give(1, {0: 2})
        cell.show(State.EXECUTE, frozenset({"green"}))
        view = cell.view()
        assert (view.taken, view.bins_taken) == (1, {0: 2})
        assert plc.lamps == 1 << RegisterMap().light["green"]
        cell.close()
    assert loads.handed[0].bins == 2


def test_one_plc_brings_the_loads_and_turns_the_fixture() -> None:
    loads = CellLoads(iter([("SN1", "SN2"), ("SN3", "SN4")]), change_s=0.05)
    plc = SimulatedPlc(RegisterMap(), 2000.0, 20000.0, loads=loads, nests=2)
    with plc_on_a_socket(plc) as port, closing(positioner(port)) as driven:
        cell = PlcCell(PlcCell.Settings(host="127.0.0.1", port=port), SystemClock())

        def measure(load: int) -> None:
            until(lambda: cell.view().ready and cell.view().load == load, "the load")
            cell.accept(load)
            for up in ("+x", "-z"):
                driven.move(stop(up), 5.0)
                cell.show(State.EXECUTE, frozenset({"green"}))  # the line goes on between two moves
                cell.view()
            driven.park(5.0)
            cell.give(load, {0: Bin.GOOD, 1: Bin.REJECT})
            until(lambda: cell.view().taken == load, "the load is taken back")

        measure(1)
        measure(2)
        cell.close()
    assert [m.number for m in plc.motions] == [1, 2, 3, 4, 5, 6]
    assert [handed.serials for handed in loads.handed] == [("SN1", "SN2"), ("SN3", "SN4")]


def test_a_network_scanner_reads_the_nest_it_is_asked_for() -> None:
    labels = {"A": "SN1", "B": "\x1d21SN2"}
    with served(lambda ready: serve_scanner("127.0.0.1", 0, labels.get, ready)) as port:
        scanner = NetworkScanner(NetworkScanner.Settings(port=port))
        assert [scanner.read(nest, 2.0) for nest in "ABC"] == ["SN1", "\x1d21SN2", None]
        scanner.close()
    with pytest.raises(StationFault, match="was lost"):
        NetworkScanner(NetworkScanner.Settings(port=port)).read("A", 0.5)


def test_a_scanner_on_a_serial_port() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.write(master, b"OLD\r")  # of the unit before
    scanner = SerialPortScanner(SerialPortScanner.Settings(port=os.ttyname(slave)))

    def reader() -> None:
        assert os.read(master, 10) == b"T\r"
        os.write(master, b"SN0042\r")

    thread = threading.Thread(target=reader)
    thread.start()
    try:
        assert scanner.read("A", 5.0) == "SN0042"
        assert scanner.read("A", 0.1) is None
    finally:
        thread.join()
        scanner.close()
        os.close(master)
        os.close(slave)
    with pytest.raises(StationFault, match="cannot be used"):
        SerialPortScanner(SerialPortScanner.Settings(port="/dev/no-such-port")).read("A", 0.1)


def test_a_keyboard_wedge_gives_a_line_to_each_nest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reads, writes = os.pipe()
    with os.fdopen(reads) as keyboard:
        monkeypatch.setattr(sys, "stdin", keyboard)
        scanner = KeyboardScanner(KeyboardScanner.Settings())
        os.write(writes, b"SN1\nSN2\r\nSN")
        assert [scanner.read(nest, 0.5) for nest in "AB"] == ["SN1", "SN2"]
        assert scanner.read("C", 0.1) is None, "half a label is none"
        os.close(writes)
        with pytest.raises(StationFault, match="Standard input was closed"):
            scanner.read("C", 0.5)
    assert capsys.readouterr().err == "A: B: C: C: "


def test_a_label_is_printed_with_serial_verdict_and_record() -> None:
    printed: list[Any] = []
    with served(lambda ready: serve_printer("127.0.0.1", 0, printed.append, ready)) as port:
        ZplPrinter(ZplPrinter.Settings(port=port)).print(UnitLabel("SN^1", "FAIL", "SN1#7", "A"))
        wanted = threading.Event()
        wanted.wait(0.1)
    assert "SN_5E1" in printed[0]["label"]
    assert "FAIL" in printed[0]["label"]


@pytest.mark.parametrize(
    ("status", "id_"),
    [
        (b"\x02030,1,0,0\x03\r\n\x02000,0,0,0\x03", "printer-paper"),
        (b"\x02030,0,1,0\x03\r\n\x02000,0,0,0\x03", "printer-paused"),
        (b"\x02030,0,0,0\x03\r\n\x02000,0,1,0\x03", "printer-head"),
        (b"\x02030,0,0,0\x03\r\n\x02000,0,0,1\x03", "printer-ribbon"),
    ],
)
def test_a_printer_that_wants_something_prints_nothing(status: bytes, id_: str) -> None:
    received: list[bytes] = []

    async def serve(ready: Callable[[int], None]) -> None:
        async def connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with closing(writer):
                await reader.read(10)
                writer.write(status)
                received.append(await reader.read(1000))

        server = await asyncio.start_server(connection, "127.0.0.1", 0)
        ready(server.sockets[0].getsockname()[1])
        async with server:
            await server.serve_forever()

    with served(serve) as port, pytest.raises(StationFault) as wants:
        ZplPrinter(ZplPrinter.Settings(port=port)).print(UnitLabel("SN1", "PASS", "r", "A"))
    assert wants.value.message.id == id_
    assert received in ([], [b""]), "no label was sent"


def test_a_line_controller_reads_the_state_and_commands_once() -> None:
    document = {"state": 6, "station": "s", "recipe": "r/1", "load": 70000, "loads": 3, "seconds": {"execute": 9.0}}
    document["nests"] = [{"nest": "A", "serial": "SN1", "outcome": "PASS"}]
    facts, sent = facts_of(document, "", alive=True), list[Command]()

    async def serve(ready: Callable[[int], None]) -> None:
        port = free_port()
        await serve_modbus(ServedLine("127.0.0.1", port, lambda: facts, sent.append, lambda _: ready(port)))

    with served(serve) as port, ModbusTcpClient("127.0.0.1", port=port, retries=0, timeout=3) as client:
        words = client.read_holding_registers(0, count=80).registers
        assert words[0] == 1
        assert words[2:8] == [6, 3, 1, 70000 - 65536, 0, 3]
        assert words[20] == 0x101
        assert words[40 + 2 * 5 + 1] == 9
        for _ in range(2):
            assert not client.write_registers(100, [4, 9]).isError()
        assert client.read_holding_registers(102, count=1).registers == [9]
        assert client.write_registers(2, [9]).isError()
        assert client.write_registers(100, [77, 10]).isError()
    assert sent == [Command.HOLD]


def test_a_simulated_line_runs_from_the_command_line(tmp_path: Path) -> None:
    import subprocess
    import sys

    config = tmp_path / "config.yaml"
    config.write_text(
        "schema: station.config/1\nnests: [{name: A, node: 0x11}]\nrecipe: offset-gain\npositioner: {kind: simulated}\n"
        "bus: {interface: simulated, channel: v}\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "station", "line", "--simulate", "--loads", "1", "--json", "--quiet"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["loads"], found["state"]) == (1, "complete")
    assert sum(found["bins"].values()) == 1
