"""A unit's life, a list of attempts and the findings of a check, as a person reads them."""

from collections.abc import Mapping, Sequence
from typing import Any

from station.cli._layout import TextTable
from station.cli._output import print_line, print_table
from station.domain.records.stored_attempt import signatures, utc
from station.messages import Message, render
from station.service import time_text

Document = Mapping[str, Any]

#: No column of words.
NONE: frozenset[int] = frozenset()
_LOSS_COUNTERS = ("lost", "gaps", "repeats", "crc_errors", "kernel_drops")


def print_audit(document: Document) -> None:
    """Prints an answer of `station audit`."""
    if "verify" in document:
        _show_check(document["verify"])
    if "serial" in document:
        for number, attempt in enumerate(document["attempts"], 1):
            _show_attempt(number, attempt)
        for flash in document["flashes"]:
            shown = {"at": utc(flash["at_ns"]), "image": flash["image"], "how": flash["how"], "nest": flash["nest"]}
            print_line(render(Message("flash-record", **shown, why=flash.get("reason") or flash.get("version", ""))))
    elif "attempts" in document:
        _show_list(document["attempts"])
    for one in document.get("recompute", ()):
        print_line(_recompute_sentence(one))
    print_line(f"head of {document['log']}: {document['head']['number']}:{document['head']['hash']}")


def print_rows(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], words: frozenset[int] = NONE) -> None:
    """Prints rows under their columns; nothing where there is no row. words: columns that may be broken."""
    if rows:
        cells = [[_cell(v) for v in row] for row in rows]
        print_table(f"  {title}", TextTable(columns, cells, words=words, rule=False, indent=4))


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return " ".join(f"{v:+.5f}" if isinstance(v, float) else _cell(v) for v in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_cell(v)}" for key, v in value.items())
    return str(value).lower() if isinstance(value, bool) else str(value)


def _show_check(check: Document) -> None:
    if check["whole"]:
        print_line(f"the chain of {check['records']} records is whole")
    for finding in check["findings"]:
        print_line(f"{finding['what']}: {finding['sentence']}")
    for anchor in check["anchors"]:
        print_line(f"compared with {anchor['place']}: record {anchor['number']}, {anchor['state']}")
    if check["journal"] and check["journal"]["lines"]:
        print_line(render(Message("journal-state", **check["journal"])))
    if check["accounts"]:
        print_line(render(Message("accounts-state", **check["accounts"])))
    for entry in check["acknowledged"]:
        what = "; ".join(f"{f['place']} {f['what']}" for f in entry["findings"])
        print_line(f"acknowledged {utc(entry['at_ns'])} by {entry['by']}: {entry['reason']} ({what})")


def _show_list(attempts: Sequence[Document]) -> None:
    started_column = f"started, {time_text.zone()}"
    columns = ("serial", "outcome", started_column, "station", "nest", "recipe", "lot", "attempt", "reason")
    rows = []
    for a in attempts:
        started, recipe = time_text.local_short(a["started_ns"]), f"{a['recipe_name']}/{a['recipe_version']}"
        reasons = [r["sentence"] for r in a.get("reasons") or ()]
        why = reasons[0] + (f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else "") if reasons else ""
        place = (started, a["station"], a["nest"])
        rows.append([a["serial"], a["outcome"], *place, recipe, a["lot"], a["attempt"], why])
    title = f"{len(attempts)} {'attempt' if len(attempts) == 1 else 'attempts'}, newest first"
    print_rows(title, columns, rows, frozenset({len(columns) - 1}))
    if not attempts:
        print_line("no such attempt")


def _recompute_sentence(one: Document) -> str:
    name = f"{one['serial']} {one['attempt']}"
    if one["skipped"]:
        return f"{name}: nothing to compute again, {one['skipped']}"
    if one["identical"]:
        return f"{name}: all {one['compared']} values come out again, bit for bit"
    count = f"{len(one['differences'])} of {one['compared']} values"
    if one["agrees"]:
        return f"{name}: all values come out again, {count} within rounding ({one['deviation']:.0e}): another processor"
    listed = ", ".join(one["differences"][:5])
    return f"{name}: {count} come out differently: {listed}"


def _show_attempt(number: int, a: Document) -> None:
    results = {r["name"]: r["document"] for r in a["results"]}
    print_line(f"{number}. {a['serial']}: {a['outcome'] or 'running'}, attempt {a['attempt']}")
    print_line(
        f"  {a['started']} to {a['ended'] or 'now'}, station {a['station']}, nest {a['nest']} (node {a['node']})"
    )
    print_line(f"  recipe {a['recipe_name']} version {a['recipe_version']}, hash {a['recipe_hash']}")
    print_line(f"  software {a['software']}, config {a['config_hash']}")
    print_line(f"  operator {a['operator'] or '-'}, lot {a['lot'] or '-'}")
    if "identity" in results:
        print_line("  identity " + ", ".join(f"{k} {v}" for k, v in results["identity"].items()))
    _show_visits(a["visits"])
    if "dwell" in results:
        lasted_s, alone_s = (sum(results["dwell"].get(key) or ()) for key in ("dwell_s", "alone_s"))
        known = (results["dwell"].get("prior") or {}).get("units", 0)
        print_line(
            f"  dwells until good enough: {lasted_s:.1f} s; this unit alone needed {alone_s:.1f} s of its own noise"
        )
        if known:
            print_line(f"  noise known beforehand from {known} units")
    _show_calibration(results.get("calibration"))
    _show_writes(a["writes"])
    _show_verification(results.get("verification"))
    _show_verdict(results.get("verdict"))
    happened = [[utc(e["at_ns"]), e["kind"], e["detail"]] for e in a["events"]]
    print_rows("events", ("at, UTC", "kind", "detail"), happened, frozenset({2}))
    for one in signatures(a):
        signed = Message("signed-line", at=utc(one["at_ns"]), meaning=one["meaning"], by=one["by"], role=one["role"])
        print_line(f"  {render(signed)}" + (f": {one['comment']}" if one["comment"] else ""))
    if a["seal"]:
        print_line(f"  sealed {a['seal']['number']}:{a['seal']['hash']}")
    print_line()


def _show_visits(visits: Sequence[Document]) -> None:
    columns = ("run", "visit", "position", "seating", "kind", "frames", "mean", "std", "degC", "lost/gaps/rep/crc/drop")
    rows = []
    for v in visits:
        s = v["statistics"]
        drops = "/".join(_cell(s.get(name)) for name in _LOSS_COUNTERS)
        place = [v["run"], v["visit"], v["position"], v["seating"], v["kind"], v["frame_count"]]
        rows.append([*place, s.get("mean"), s.get("std"), s.get("temperature_degC"), drops])
    print_rows("visits", columns, rows)


def _show_calibration(found: Document | None) -> None:
    if found is None:
        return
    print_line(f"  calibration: {_cell(found.get('outcome'))} by its limits")
    for reason in [*(found.get("reasons") or ()), *(found.get("notes") or ())]:
        print_line(f"    {reason}")
    offset, matrix, rms = (found.get(name) for name in ("offset", "matrix", "residual_rms"))
    if offset is None or matrix is None:
        return
    names = [f"offset {a}" for a in "xyz"] + [f"matrix {i}{j}" for i in "xyz" for j in "xyz"]
    values = [*offset, *(v for row in matrix for v in row)]
    variances = [row[i] for i, row in enumerate(found.get("covariance") or ())] or [None] * len(values)
    std = ["-" if variance is None else f"{max(variance, 0.0) ** 0.5:.2g}" for variance in variances]
    rows = [[n, f"{v:+.7f}", s] for n, v, s in zip(names, values, std, strict=False)]
    title = "measured = matrix · true + offset" + (f", residual rms {rms:.3g}" if rms is not None else "")
    print_rows(title, ("name", "value", "std"), rows)


def _show_writes(writes: Sequence[Document]) -> None:
    """Each object once, as it stood at its last stage."""
    last = {(w["object"], w["name"]): w for w in writes}
    columns = ("object", "name", "stage", "old", "written", "read_back", "value")
    print_rows("object writes (bytes as on the wire)", columns, [[w[c] for c in columns] for w in last.values()])


def _show_verification(found: Document | None) -> None:
    if found is None:
        return
    columns = ("name", "mean", "true", "error")
    rows = [[p.get(c) for c in columns] for p in found.get("positions") or ()]
    title = f"verified through its own output, limit {_cell(found.get('limit'))}"
    print_rows(title, ("position", *columns[1:]), rows)


def _show_verdict(found: Document | None) -> None:
    if found is None:
        return
    outcome, written, verified = (_cell(found.get(name)) for name in ("outcome", "written", "verified"))
    print_line(f"  verdict {outcome}, written {written}, verified {verified}")
    if found.get("rule"):
        print_line(f"    rule {found['rule']}; false accept {_cell(found.get('false_accept'))}")
    for reason in found.get("reasons") or ():
        print_line(f"    {reason.get('check', '')}: {reason.get('sentence', '')}")
