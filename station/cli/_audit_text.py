"""A unit's life, a list of attempts and the findings of a check, as a person reads them."""

import textwrap
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from station.cli import _output
from station.domain.records.stored_attempt import signatures, utc
from station.messages import Message, render
from station.service import time_text

Document = Mapping[str, Any]

_LOSS_COUNTERS = ("lost", "gaps", "repeats", "crc_errors", "kernel_drops")


def print_audit(document: Document) -> None:
    """Prints an answer of `station audit`."""
    if "verify" in document:
        _show_check(document["verify"])
    if "serial" in document:
        for number, attempt in enumerate(document["attempts"], 1):
            _show_attempt(number, attempt)
    elif "attempts" in document:
        _show_list(document["attempts"])
    for one in document.get("recompute", ()):
        _line(_recompute_sentence(one))
    _line(f"head of {document['log']}: {document['head']['number']}:{document['head']['hash']}")


def _line(text: str = "") -> None:
    """Serials and sentences come from outside: nothing in them may steer the terminal."""
    clean = "".join(c if c.isprintable() else " " for c in text)
    width = _output.line_width()
    indent = " " * (len(clean) - len(clean.lstrip()))
    if width is None or len(clean) <= width:
        _output.print_line(clean)
        return
    for part in textwrap.wrap(clean, width, subsequent_indent=f"{indent}  ", break_long_words=False):
        _output.print_line(part)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Prints rows under their columns, each as wide as it must be; nothing where there is no row."""
    if not rows:
        return
    cells = [["".join(c if c.isprintable() else " " for c in _cell(v)) for v in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(columns, *cells, strict=True)]
    _line(f"  {title}")
    parts = _fold(widths)
    for row in chain([columns], cells):
        for number, part in enumerate(parts):
            indent = "    " if number == 0 else "      "
            _output.print_line((indent + "  ".join(f"{row[i]:<{widths[i]}}" for i in part)).rstrip())


def _fold(widths: Sequence[int]) -> list[list[int]]:
    """Columns line by line: a row too wide for the screen goes on in the next line, and no digit is cut off."""
    limit = _output.line_width()
    parts: list[list[int]] = [[]]
    for i, width in enumerate(widths):
        used = sum(widths[j] + 2 for j in parts[-1]) + 6
        if limit is not None and parts[-1] and used + width > limit:
            parts.append([])
        parts[-1].append(i)
    return parts


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return " ".join(f"{v:+.5f}" if isinstance(v, float) else _cell(v) for v in value)
    return str(value)


def _show_check(check: Document) -> None:
    if check["whole"]:
        _line(f"the chain of {check['records']} records is whole")
    for finding in check["findings"]:
        _line(f"{finding['what']}: {finding['sentence']}")
    for anchor in check["anchors"]:
        _line(f"compared with {anchor['place']}: record {anchor['number']}, {anchor['state']}")
    if check["journal"] and check["journal"]["lines"]:
        _line(render(Message("journal-state", **check["journal"])))
    if check["accounts"]:
        _line(render(Message("accounts-state", **check["accounts"])))
    for entry in check["acknowledged"]:
        what = "; ".join(f"{f['place']} {f['what']}" for f in entry["findings"])
        _line(f"acknowledged {utc(entry['at_ns'])} by {entry['by']}: {entry['reason']} ({what})")


def _show_list(attempts: Sequence[Document]) -> None:
    started_column = f"started, {time_text.zone()}"
    columns = ("serial", "outcome", started_column, "station", "nest", "recipe", "lot", "attempt", "reason")
    rows = []
    for a in attempts:
        started, recipe = time_text.local_short(a["started_ns"]), f"{a['recipe_name']}/{a['recipe_version']}"
        reasons = [r["sentence"] for r in a.get("reasons") or ()]
        why = reasons[0] + (f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else "") if reasons else "-"
        place = (started, a["station"], a["nest"])
        rows.append([a["serial"], a["outcome"], *place, recipe, a["lot"], a["attempt"], why])
    print_table(f"{len(attempts)} {'attempt' if len(attempts) == 1 else 'attempts'}, newest first", columns, rows)
    if not attempts:
        _line("no such attempt")


def _recompute_sentence(one: Document) -> str:
    name = f"{one['serial']} {one['attempt']}"
    if one["skipped"]:
        return f"{name}: nothing to compute again, {one['skipped']}"
    if one["identical"]:
        return f"{name}: all {one['compared']} values come out again, bit for bit"
    listed = ", ".join(one["differences"][:5])
    return f"{name}: {len(one['differences'])} of {one['compared']} values come out differently: {listed}"


def _show_attempt(number: int, a: Document) -> None:
    results = {r["name"]: r["document"] for r in a["results"]}
    _line(f"{number}. {a['serial']}: {a['outcome'] or 'running'}, attempt {a['attempt']}")
    _line(f"  {a['started']} to {a['ended'] or 'now'}, station {a['station']}, nest {a['nest']} (node {a['node']})")
    _line(f"  recipe {a['recipe_name']} version {a['recipe_version']}, hash {a['recipe_hash']}")
    _line(f"  software {a['software']}, config {a['config_hash']}")
    _line(f"  operator {a['operator'] or '-'}, lot {a['lot'] or '-'}")
    if "identity" in results:
        _line("  identity " + ", ".join(f"{k} {v}" for k, v in results["identity"].items()))
    _show_visits(a["visits"])
    if "dwell" in results:
        lasted_s, alone_s = (sum(results["dwell"][key]) for key in ("dwell_s", "alone_s"))
        known = (results["dwell"].get("prior") or {}).get("units", 0)
        _line(f"  dwells until good enough: {lasted_s:.1f} s; this unit alone needed {alone_s:.1f} s of its own noise")
        if known:
            _line(f"  noise known beforehand from {known} units")
    _show_calibration(results.get("calibration"))
    _show_writes(a["writes"])
    _show_verification(results.get("verification"))
    _show_verdict(results.get("verdict"))
    print_table("events", ("at_ns", "kind", "detail"), [[e["at_ns"], e["kind"], e["detail"]] for e in a["events"]])
    for one in signatures(a):
        signed = Message("signed-line", at=utc(one["at_ns"]), meaning=one["meaning"], by=one["by"], role=one["role"])
        _line(f"  {render(signed)}" + (f": {one['comment']}" if one["comment"] else ""))
    if a["seal"]:
        _line(f"  sealed {a['seal']['number']}:{a['seal']['hash']}")
    _line()


def _show_visits(visits: Sequence[Document]) -> None:
    columns = ("run", "visit", "position", "seating", "kind", "frames", "mean", "std", "degC", "lost/gaps/rep/crc/drop")
    rows = []
    for v in visits:
        s = v["statistics"]
        drops = "/".join(_cell(s.get(name)) for name in _LOSS_COUNTERS)
        place = [v["run"], v["visit"], v["position"], v["seating"], v["kind"], v["frame_count"]]
        rows.append([*place, s.get("mean"), s.get("std"), s.get("temperature_degC"), drops])
    print_table("visits", columns, rows)


def _show_calibration(found: Document | None) -> None:
    if found is None:
        return
    _line(f"  calibration: {found['outcome']} by its limits")
    for reason in [*found["reasons"], *found["notes"]]:
        _line(f"    {reason}")
    if found["offset"] is None:
        return
    std = [max(found["covariance"][i][i] or 0.0, 0.0) ** 0.5 for i in range(12)]
    names = [f"offset {a}" for a in "xyz"] + [f"matrix {i}{j}" for i in "xyz" for j in "xyz"]
    values = [*found["offset"], *(v for row in found["matrix"] for v in row)]
    rows = [[n, f"{v:+.7f}", f"{s:.2g}"] for n, v, s in zip(names, values, std, strict=True)]
    title = f"measured = matrix · true + offset, residual rms {found['residual_rms']:.3g}"
    print_table(title, ("name", "value", "std"), rows)


def _show_writes(writes: Sequence[Document]) -> None:
    """Each object once, as it stood at its last stage."""
    last = {(w["object"], w["name"]): w for w in writes}
    columns = ("object", "name", "stage", "old", "written", "read_back", "value")
    print_table("object writes (bytes as on the wire)", columns, [[w[c] for c in columns] for w in last.values()])


def _show_verification(found: Document | None) -> None:
    if found is None:
        return
    rows = [[p["name"], p["mean"], p["true"], p["error"]] for p in found["positions"]]
    title = f"verified through its own output, limit {_cell(found['limit'])}"
    print_table(title, ("position", "mean", "true", "error"), rows)


def _show_verdict(found: Document | None) -> None:
    if found is None:
        return
    _line(f"  verdict {found['outcome']}, written {found['written']}, verified {found['verified']}")
    if found["rule"]:
        _line(f"    rule {found['rule']}; false accept {_cell(found['false_accept'])}")
    for reason in found["reasons"]:
        _line(f"    {reason['check']}: {reason['sentence']}")
