"""`station plant`: the receiver of many stations' records, in front of PostgreSQL."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

#: Options that only go with one of these words.
GOES_WITH = {
    "--key": ("register",), "--log": ("adopt", "reject"), "--by": ("adopt", "reject"), "--reason": ("adopt", "reject"),
    "--station": ("grant",), "--product": ("grant",), "--json": ("status", "verify"),
}  # fmt: skip


def command(
    action: Annotated[str, Argument(help="serve, status, register, adopt, reject, grant, verify, retire.")] = "serve",
    name: Annotated[str, Argument(help="With register, adopt, reject: the station. With grant: a person's role.")] = "",
    config: Annotated[Path, Option(help="The plant's settings.")] = Path("plant.yaml"),
    host: Annotated[str, Option(help="Address to listen at; only this machine unless told otherwise.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any free one.")] = 8443,
    key: Annotated[Path | None, Option(help="With register: the station's public key, PEM.")] = None,
    log: Annotated[str, Option(help="With adopt, reject: the log's id, as in status; left out: the only one.")] = "",
    by: Annotated[str, Option(help="With adopt, reject: who decides.")] = "",
    reason: Annotated[str, Option(help="With adopt, reject: why.")] = "",
    station: Annotated[list[str] | None, Option(help="With grant: only this station; repeatable.")] = None,
    product: Annotated[list[str] | None, Option(help="With grant: only this product; repeatable.")] = None,
    json: Annotated[bool, Option("--json", help="With status, verify: one JSON document.")] = False,
) -> int:
    """Keep the records of many stations in PostgreSQL; every record is checked when it comes.

    plant.yaml, then its first station (its token is said once):

        echo 'schema: station.plant/1' > plant.yaml

        echo 'database: "postgresql:///plant"' >> plant.yaml

        station plant register bench-1 --key station.pub

        station plant serve --host 0.0.0.0

    What was refused and waits for a decision, and one decision (or `reject`: it stays out):

        station plant status

        station plant adopt bench-1 --by "Ada Lovelace" --reason "disk replaced on Monday"

    A person who may ask about one product, through a database role of her own:

        station plant grant anna --product accelerometer

    Every command that reads a log reads the plant, too: station audit SN0042 --db postgresql:///plant
    """
    from station.cli import _plant
    from station.errors import UsageError

    if action in ("adopt", "reject"):
        decide = _plant.adopt if action == "adopt" else _plant.reject
        return decide(config, _named(name, action), log, by.strip(), reason.strip())
    actions = {
        "serve": lambda: _plant.serve(config, host, port),
        "status": lambda: _plant.status(config, as_json=json),
        "verify": lambda: _plant.verify(config, as_json=json),
        "retire": lambda: _plant.retire(config),
        "register": lambda: _plant.register(config, _named(name, action), key),
        "grant": lambda: _plant.grant(config, _named(name, action), station or [], product or []),
    }
    if action not in actions:
        raise UsageError("plant-action", action=action)
    return actions[action]()


def _named(name: str, action: str) -> str:
    """The name after the action. Errors: UsageError."""
    from station.errors import UsageError

    if not name:
        raise UsageError("plant-name-missing", action=action)
    return name
