"""`station rig`: commissioning of a rig of drives, its axes' errors, and simulated machines around the station."""

from station.cli import _rig_options as given

#: Options that only go with one of these words.
GOES_WITH = {
    "--bench": ("check",), "--recipe": ("check",), "--mounted": ("check",), "--speed": ("check",),
    "--db": ("axes",), "--since": ("axes",), "--units": ("axes",),
    "--config": ("check", "axes"), "--correct": ("check", "axes"), "--json": ("check", "axes"),
    "--channel": ("--simulate",), "--interface": ("--simulate",), "--host": ("--simulate",), "--port": ("--simulate",),
    "--nests": ("--simulate",), "--loads": ("--simulate",), "--change-s": ("--simulate",),
    "--scanner-port": ("--simulate",), "--memory": ("--simulate",), "--label": ("--simulate",),
    "--fault": ("--simulate",), "--seconds": ("--simulate",), "--map": ("--simulate", "axes"),
}  # fmt: skip


def command(
    action: given.Action = "",
    simulate: given.Simulate = None,
    channel: given.Channel = "vcan1",
    interface: given.Interface = "socketcan",
    host: given.Host = "127.0.0.1",
    port: given.Port = 0,
    map: given.Map = None,  # noqa: A002
    nests: given.Nests = 4,
    loads: given.Loads = None,
    change_s: given.Change = 1.0,
    scanner_port: given.ScannerPort = None,
    memory: given.Memory = None,
    label: given.Label = None,
    fault: given.Fault = None,
    seconds: given.Seconds = None,
    config: given.Config = None,
    recipe: given.Recipe = None,
    bench: given.Bench = False,
    mounted: given.Mounted = None,
    speed: given.Speed = 15.0,
    db: given.Database = None,
    since: given.Since = None,
    units: given.Units = 64,
    correct: given.Correct = None,
    json_: given.AsJson = False,
) -> int:
    """Commission a rig of drives, find its axes' errors, or simulate a machine that stands around the station.

    With units in the nests, nobody near the rig and a hand on the emergency stop: moves each axis a little, then slowly
    all around, and compares the encoders with the gravity that the units feel; the same without anything real:

        station rig check --config drives.yaml --correct corrected.yaml
        station rig check --config drives.yaml --bench

    Zeros, scales, non-orthogonality and index errors of the axes, from what eight or more units measured on them:

        station run --config drives.yaml --units 8
        station rig axes --config drives.yaml --since 7d --correct corrected.yaml

    Two simulated drives until Ctrl-C, on CAN frames by multicast (with --channel vcan1 alone, there); a PLC with its
    cell, and a door that opens in the third move:

        station rig --simulate cia402 --interface udp_multicast --channel 239.74.163.2
        station rig --simulate plc --port 5020 --scanner-port 9004 --loads 10 --fault door-opened:at=3,seconds=2
    """
    faults = tuple(fault or ())
    if action == "check":
        from station.cli._rig_drives import CheckRequest, check

        return check(CheckRequest(config, recipe, bench, mounted, speed, correct, json_))
    if action == "axes":
        from station.cli._rig_axes import AxesRequest, axes

        return axes(AxesRequest(config, db, map, since, units, correct, json_))
    from station.cli._rig import CellOptions, Machine, simulate_machine

    cell = CellOptions(nests, loads, change_s, scanner_port, memory)
    machine = Machine((interface, channel), host, port, map, tuple(label or ()), faults, seconds, cell)
    return simulate_machine(action, simulate, machine)
