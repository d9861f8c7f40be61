"""What the commands that read a log share: which log, what time is meant, which attempts."""

from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from station.domain.core.types import Outcome
from station.errors import UsageError
from station.messages.labels import check_names
from station.service import time_text

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader


def open_named_log(db: Path | None, config: Path | None) -> "LogReader":
    """The log named on the command line, or else the one that config.yaml names. Errors: LogError, ConfigError."""
    from station.wiring.logs import open_log

    if db is None or config is not None:
        from station.config.settings import load_settings

        database = load_settings(config).database
        db = db or Path(database)
    return open_log(db)


def parse_time_ns(text: str | None, option: str) -> int | None:
    """`2026-11-21`, `2026-11-21T13:00` (local unless it says otherwise) or `7d` ago, since 1970 in ns; a day given as
    `--until` counts whole, as on the page."""
    if text is None:
        return None
    try:
        return time_text.parse_ns(text, end=option == "--until")
    except time_text.NoTime as exc:
        raise UsageError("option-not-a-time", option=option, text=text[:40]) from exc
    except OverflowError as exc:
        raise UsageError("option-time-range", option=option, text=text[:40]) from exc


def parse_span_ns(since: str | None, until: str | None) -> tuple[int | None, int | None]:
    """`--since` and `--until`, since 1970 in ns. Errors: UsageError, also where the span ends before it begins."""
    begin, end = parse_time_ns(since, "--since"), parse_time_ns(until, "--until")
    if begin is not None and end is not None and begin > end:
        raise UsageError("span-reversed", since=str(since)[:40], until=str(until)[:40])
    return begin, end


def parse_outcome(text: str | None) -> str | None:
    """An outcome in any case, as the log writes it. Errors: UsageError."""
    if text is None:
        return None
    if (outcome := text.strip().upper()) not in tuple(Outcome):
        raise UsageError("outcome-unknown", text=text[:40], outcomes=tuple(Outcome))
    return outcome


def parse_check(text: str | None) -> str | None:
    """A limit or another reason to fail, as the log names it. Errors: UsageError."""
    if text is None:
        return None
    known = check_names()
    if (check := text.strip().lower()) not in known:
        raise UsageError("check-unknown", text=text[:40], nearest=get_close_matches(check, known, 2, 0.0), known=known)
    return check


def parse_head(text: str | None) -> dict[int, bytes]:
    """`NUMBER:HASH` as certificates and exports print it; nothing where nothing was said."""
    if text is None:
        return {}
    number, _, seal = text.partition(":")
    if not number.isdigit() or len(seal) != 64 or set(seal.lower()) - set("0123456789abcdef"):
        raise UsageError("option-head-form")
    return {int(number): bytes.fromhex(seal)}
