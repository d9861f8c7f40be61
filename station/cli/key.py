"""`station key`: the key that signs the log, handed over or revoked."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {
    "--to": ("rotate",), "--key": ("revoke",), "--beyond": ("revoke",), "--by": ("revoke",), "--reason": ("revoke",)
}  # fmt: skip


def command(
    action: Annotated[str, Argument(help="rotate or revoke.")],
    to: Annotated[str | None, Option(help="With rotate: the new key, a PEM file or pkcs11:token=…;object=….")] = None,
    key: Annotated[Path | None, Option(help="With revoke: the key, PEM.")] = None,
    beyond: Annotated[int | None, Option(min=0, help="With revoke: the last record that it is trusted for.")] = None,
    by: Annotated[str, Option(help="With revoke: who.")] = "",
    reason: Annotated[str, Option(help="With revoke: why.")] = "",
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Hand the log over to a new signing key, or stop trusting an old one.

    The old key of config.yaml signs the new one; then put the new one into config.yaml:

        station key rotate --to new.key --db line-2.db

    A key was stolen: its signatures count only up to record 12 from now on:

        station key revoke --key stolen.pub --beyond 12 --by "Ada Lovelace" --reason "laptop stolen" --db line-3.db

    Auditors pin any one key of the log (`trusted_key:` in config.yaml, or --key): every other one must follow from it.
    """
    from station.cli._output import print_line
    from station.config.settings import load_settings
    from station.errors import UsageError
    from station.messages import Message, render
    from station.wiring import logs

    settings = load_settings(config)
    path = db or Path(settings.database)
    if action == "rotate" and to and settings.signing_key:
        public = logs.rotate_key(path, settings, to)
        print_line(render(Message("key-rotated", path=str(path), key=public[:16], to=to)))
    elif action == "revoke" and key and beyond is not None and by.strip() and reason.strip():
        logs.revoke_key(path, settings, key, beyond, by.strip(), reason.strip())
        print_line(render(Message("key-revoked", path=str(path), file=str(key), beyond=beyond)))
    elif action == "rotate":
        raise UsageError("key-rotate-form")
    elif action == "revoke":
        raise UsageError("key-revoke-form")
    else:
        raise UsageError("key-action", action=action)
    return 0
