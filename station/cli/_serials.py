"""Serials from the command line, a prompt, or a scanner that types lines on standard input."""

import sys
from collections.abc import Iterator, Sequence

from station.config.settings import load_settings
from station.domain.core.types import NestAssignment
from station.domain.product.product import serial_of
from station.domain.recipe import serial
from station.errors import UsageError
from station.wiring.bench import Bench
from station.wiring.jobs import load_job
from station.wiring.run_order import RunOrder

#: A scanner that floods is no scanner.
LONGEST_LINE = 200


def ask_serials(bench: Bench, given: Sequence[str], units: int | None) -> tuple[str, ...]:
    """The serials of this run, checked one by one as they come. Errors: UsageError."""
    if given:
        if units is not None and units != len(given):
            raise UsageError("units-and-serials", units=units, serials=len(given))
        return tuple(given)
    if bench.simulated:
        return tuple(f"SN{i + 1:04d}" for i in range(units or len(bench.station.settings.nests)))
    found = tuple(_prompted(bench, units) if sys.stdin.isatty() else _scanned(bench, units))
    if not found:
        raise UsageError("no-serials")
    return found


def check_given(order: RunOrder, serials: Sequence[str]) -> None:
    """UsageError for serials that are none of the recipe's or the product's, before a log is made for them."""
    job, _ = load_job(order.recipe or load_settings(order.config).recipe)
    for text in serial.check_all(serials, job.recipe):
        serial_of(job.product.map, text)


def assign_nests(bench: Bench, serials: Sequence[str], nests: Sequence[str]) -> list[tuple[NestAssignment, ...]]:
    """The loads: each serial in the nest said for it, or nest by nest where none is. Errors: UsageError."""
    if not nests:
        return bench.loads(serials)
    nodes = {n.name: n.node for n in bench.station.settings.nests}
    unknown = [n for n in nests if n not in nodes]
    if unknown:
        raise UsageError("unknown-nest", nest=unknown[0][:40], nests=tuple(nodes))
    if len(nests) != len(serials) or len(set(nests)) != len(nests):
        raise UsageError("serials-and-nests", serials=len(serials), nests=len(set(nests)))
    return [tuple(NestAssignment(s, n, nodes[n]) for s, n in zip(serials, nests, strict=True))]


def _scanned(bench: Bench, units: int | None) -> Iterator[str]:
    count = 0
    while (units is None or count < units) and (line := sys.stdin.readline(LONGEST_LINE)):
        if text := line.strip("\r\n\t "):
            yield serial.check(text, bench.job.recipe)
            count += 1


def _prompted(bench: Bench, units: int | None) -> Iterator[str]:
    """One nest after the other; a wrong serial is asked for again, an empty line starts the run."""
    scanned: list[str] = []
    nests = bench.station.settings.nests
    wanted = units or len(nests)
    while len(scanned) < wanted:
        nest = nests[len(scanned) % len(nests)]
        print(f"serial of the unit in nest {nest.name} (empty: start): ", end="", file=sys.stderr, flush=True)
        text = sys.stdin.readline(LONGEST_LINE).strip()
        if not text:
            return
        try:
            serial.check_all([*scanned, text], bench.job.recipe)
        except UsageError as exc:
            print(exc.sentence, file=sys.stderr)
            continue
        scanned.append(text)
        yield text
