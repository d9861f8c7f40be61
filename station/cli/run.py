"""`station run`: the main job."""

from station.cli import _run_options as given


def command(
    recipe: given.Recipe = None,
    config: given.Config = None,
    simulate: given.Simulate = False,
    units: given.Units = None,
    serial: given.Serials = None,
    nest: given.Nests = None,
    db: given.Database = None,
    effect: given.Effects = None,
    fault: given.Faults = None,
    seed: given.Seed = 1,
    model: given.Model = None,
    device_state: given.DeviceState = None,
    mounted: given.Mounted = None,
    pace: given.Pace = None,
    interface: given.Interface = None,
    channel: given.Channel = None,
    operator: given.Operator = None,
    lot: given.Lot = None,
    ask_at_page: given.AskAtPage = False,
    json: given.AsJson = False,
) -> int:
    """Take units through the recipe: calibrate, judge, write back, verify, log.

    On a virtual bus, without any hardware:

        station run --simulate --units 4

    On a bench, serials from the command line, a scanner on standard input, or a prompt:

        station run --recipe six-point --serial SN0042 --serial SN0043
    """
    from station.cli._run import RunOptions, run_units
    from station.errors import UsageError
    from station.wiring.rehearsal import rehearsing
    from station.wiring.run_order import RunOrder

    order = RunOrder(
        recipe=recipe,
        config=config,
        database=db,
        simulate=simulate,
        seed=seed,
        effects=tuple(effect or ()),
        faults=tuple(fault or ()),
        model=model,
        device_state=device_state,
        interface=interface,
        channel=channel,
        operator=operator,
        lot=lot,
        mounted=mounted,
    )
    if pace is not None and not simulate and not rehearsing(config):
        raise UsageError("option-needs-simulate", option="--pace")
    face = RunOptions(as_json=json, pace=pace, nests=tuple(nest or ()), confirm_at_page=ask_at_page)
    return run_units(order, tuple(serial or ()), units, face)
