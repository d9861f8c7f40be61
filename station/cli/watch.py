"""`station watch`: what begins to go wrong, where, since when."""

from typing import Annotated

from typer import Option

from station.cli._options import ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {"--every": ("--follow",)}


def command(
    db: LogPath = None,
    config: ConfigPath = None,
    follow: Annotated[bool, Option("--follow", help="Go on: watch each load as it comes, until Ctrl-C.")] = False,
    since: Annotated[str | None, Option(help="Only what lasts, or ended then or later: 2026-11-21, 7d.")] = None,
    run_length: Annotated[
        int, Option(min=10, max=1_000_000, help="Loads between false alarms, on average, at least.")
    ] = 1000,
    every: Annotated[float, Option(min=0.1, max=3600, help="With --follow: seconds between two looks.")] = 2.0,
    json: Annotated[bool, Option("--json", help="One line of JSON for each alert.")] = False,
) -> int:
    """Tell after each load what begins to go wrong, where, and since when.

    All loads of the log, once; 0 when all is quiet, 1 when something was found:

        station watch --db station.db

    Watched are tilt, offset, gain, residual and noise of each nest and of all nests, the base, and each position. The
    first 30 loads of a recipe are learnt. An alert ends by itself once its cause is put right. With --follow and
    `alerts:` in config.yaml, alerts go to webhooks, by mail and onto the page; the next load seals them into the log.
    """
    from station.cli import _watch
    from station.cli._log_options import open_named_log, parse_time_ns

    since_ns = parse_time_ns(since, "--since")
    if follow:
        _watch.wait_for_log(db, config, every)
    with open_named_log(db, config) as log, _watch.alert_desk(db, config, follow=follow) as desk:
        request = _watch.WatchRequest(run_length, since_ns, every if follow else None)
        return _watch.run_watch(log, request, desk, as_json=json)
