"""The finding in words: one sentence a person on the line can act on."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.messages import templates
from station.model.tie_breakers import tie_breakers
from station.reporting.diagnosis.cause_text import cause_text
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.quantity_format import display_unit, format_significant, format_size
from station.reporting.diagnosis.sentences import report_text

CauseDocument = Mapping[str, Any]
#: A next run that promises less may leave causes tied.
LIKELY = 0.9

#: Verdict → symbol and message of its badge.
BADGES = {
    "none": ("✔", "badge-none"),
    "named": ("▲", "badge-named"),
    "incomplete": ("◐", "badge-incomplete"),
    "unknown": ("?", "badge-unknown"),
}


@dataclass(frozen=True, slots=True)
class FirstScreen:
    """The first screen in words: the sentence, and what to do now."""

    sentence: str
    do: str


def first_screen(data: ReportData) -> FirstScreen:
    """What is wrong, how big, on whom, what it costs; and what to do."""
    return {"none": _none, "unknown": _unknown}.get(str(data.document["verdict"]), _cause_screen)(data)


def _none(data: ReportData) -> FirstScreen:
    base, counts = data.document["baseline"], data.document["data"]
    factor, unit = display_unit([base["residual_rms"], base["floor_rms"]], base["unit"])
    rms, floor = (format_significant(base[k] * factor) for k in ("residual_rms", "floor_rms"))
    return FirstScreen(
        report_text("finding-none", visits=counts["visits"], units=counts["units"], rms=rms, floor=floor, unit=unit),
        report_text("do-none", causes=len(data.document["considered"])),
    )


def _unknown(data: ReportData) -> FirstScreen:
    base, what = data.document["baseline"], describe_dependence(data)
    factor, unit = display_unit([base["residual_rms"], data.noise_rms], base["unit"])
    rms, noise = (format_significant(x * factor) for x in (base["residual_rms"], data.noise_rms))
    return FirstScreen(
        report_text("finding-unknown", what=what, rms=rms, noise=noise, unit=unit),
        next_run_sentence(data) or report_text("do-unknown", what=what),
    )


def _cause_screen(data: ReportData) -> FirstScreen:
    cause = leading_cause(data)
    also = list(dict.fromkeys(c["effect"] for c in data.causes if c["effect"] != cause["effect"]))
    parts = [f"{describe_cause(cause)}.", describe_size(cause, data), *describe_cost(cause, data)]
    if also:
        parts.append(report_text("finding-more", count=len(also), names=also))
    if data.document["verdict"] == "incomplete":
        parts.append(report_text("finding-rest", what=describe_dependence(data)))
    return FirstScreen(" ".join(filter(None, parts)), _advice(cause, data))


def _advice(cause: CauseDocument, data: ReportData) -> str:
    """What to do about a cause; about each that it may be, where the data cannot tell and no next run would."""
    members = [cause["effect"], *cause["indistinguishable_from"]]
    if len(members) > 1 and (data.document.get("next_run") or {}).get("separates"):
        return next_run_sentence(data)
    remedies = [(name, do) for name in members[:3] if (do := cause_text(name).do)]
    if len(members) == 1:
        return upper_first(f"{remedies[0][1]}.") if remedies else ""
    return " ".join(report_text("do-if", name=name, remedy=do) for name, do in remedies)


def leading_cause(data: ReportData) -> CauseDocument:
    """The cause that explains most of what is wrong; the one found first where several do."""
    return max(data.causes, key=_explained)


def _explained(cause: CauseDocument) -> float:
    before, after = (cause["gain"][key] or 0.0 for key in ("rms_before", "rms_after"))
    return float(before**2 - after**2)


def describe_cause(cause: CauseDocument) -> str:
    """What the cause is; all that it may be where the data cannot tell."""
    others = cause["indistinguishable_from"]
    physics = cause_text(cause["effect"]).physics
    if not others:
        return physics
    return report_text("finding-tied", names=[cause["effect"], *others], physics=_lower_first(physics))


def describe_size(cause: CauseDocument, data: ReportData) -> str:
    """Size and who has it, from the parameters."""
    rows = main_parameters(cause)
    numbers = [row for row in rows if not isinstance(row["value"], str)]
    if not rows:
        return ""
    where = describe_affected(cause, data)
    if not numbers:
        return report_text("finding-mapping", mapping=str(rows[0]["value"]), where=where)
    largest = max(numbers, key=lambda row: abs(row["value"]))
    size = format_size(abs(largest["value"]), largest["unit"])
    return report_text("finding-sizes" if len(numbers) > 1 else "finding-size", size=size, where=where)


def main_parameters(cause: CauseDocument) -> list[Mapping[str, Any]]:
    """The rows of the cause's coefficient, without those of its form."""
    rows: Sequence[Mapping[str, Any]] = cause["parameters"]
    return [row for row in rows if row["name"] == rows[0]["name"]]


def describe_affected(cause: CauseDocument, data: ReportData) -> str:
    """Who is affected, in words."""
    groups = list(dict.fromkeys(str(row["of"]) for row in main_parameters(cause)))
    kind, names = groups[0].split(":", 1)[0], [g.split(":", 1)[-1] for g in groups]
    units = data.document["data"]["units"]
    if kind == "common":
        return report_text("where-all" if units > 1 else "where-this")
    if kind == "unit":
        return (
            report_text("where-unit", name=names[0])
            if len(names) == 1
            else report_text("where-units", count=len(names), units=units)
        )
    if kind in ("visit", "run"):
        serial, run, *visit = names[0].rsplit("/", 2 if kind == "visit" else 1)
        one = (
            report_text("where-visit", name=serial, run=run, visit=visit[0])
            if visit
            else report_text("where-run", name=serial, run=run)
        )
        several = "where-visits" if visit else "where-runs"
        return one if len(names) == 1 else report_text(several, count=len(names), first=one)
    if len(names) == 1:
        return f"{kind} {names[0]}"
    return report_text("where-groups", count=len(names), kind=kind, names=", ".join(names[:3]) + _ellipsis(names))


def describe_cost(cause: CauseDocument, data: ReportData) -> Iterator[str]:
    """What the cause costs, and what knowing it gains on data that were not fitted."""
    gain, unit = cause["gain"], data.unit_of_readings
    if gain["rms_before"] is not None and gain["rms_after"] is not None:
        factor, words = display_unit([gain["rms_before"], gain["rms_after"]], unit)
        before, after = format_significant(gain["rms_before"] * factor), format_significant(gain["rms_after"] * factor)
        falls = gain["rms_after"] < gain["rms_before"]
        yield report_text("cost-gain" if falls else "cost-stays", before=before, after=after, unit=words)
        moved = largest_shift(data)
        if moved is not None and moved[1] > 0.2 * gain["rms_before"]:
            yield report_text("cost-moves", name=moved[0], size=format_size(moved[1], unit))
    if (v := data.judged) is not None and v["passed_after"] != v["passed_before"]:
        total, passed_before, passed_after = len(v["units"]), v["passed_before"], v["passed_after"]
        yield report_text("cost-yield", before=passed_before, after=passed_after, units=total)


def largest_shift(data: ReportData) -> tuple[str, float] | None:
    """The unit whose calibrated readings the causes move most, and by how much, recipe's unit; None where not known."""
    if data.line is None:
        return None
    worst = max(data.line["units"], key=lambda u: u["moves"])
    return worst["serial"], worst["moves"] / 1e3


def describe_dependence(data: ReportData) -> str:
    """What the unexplained rest depends on."""
    known = templates("en")
    words = [str(w) for w in data.document["unknown"]["depends_on"]]
    named = [report_text(f"depends-{w}") if f"depends-{w}" in known else w for w in words]
    return report_text("list-and", first=", ".join(named[:-1]), last=named[-1]) if len(named) > 1 else "".join(named)


def next_run_sentence(data: ReportData) -> str:
    """The next run as a sentence, empty where none is proposed."""
    run = data.document.get("next_run")
    if not run:
        return ""
    separates, change = run.get("separates") or [], run["recipe_change"]
    if not separates:
        return report_text("next-other", change=change) if change else report_text("next-none")
    parts = [report_text("next-run", change=change, minutes=format_significant(run["minutes"], 2), names=separates)]
    parts += _chance_sentences(run)
    if run.get("leaves"):
        parts.append(report_text("next-leaves", names=run["leaves"]))
        parts += [report_text("next-beyond", change=text) for text in dict.fromkeys(tie_breakers(run["leaves"]))]
    return " ".join(parts)


def _chance_sentences(run: Mapping[str, Any]) -> Iterator[str]:
    """What a next run promises, how that is known, and that nothing promises more where it is little."""
    certainty, interval = run.get("certainty"), run.get("certainty_interval")
    if certainty is None:
        return
    yield report_text("next-certainty", percent=math.floor(100 * certainty))
    if interval is not None:
        low, high = math.floor(100 * interval[0]), math.ceil(100 * interval[1])
        yield report_text("next-simulated", sets=run["simulated_diagnoses"], low=low, high=high)
        if certainty < LIKELY:
            yield report_text("next-limit")


def _ellipsis(names: Sequence[str]) -> str:
    return " …" if len(names) > 3 else ""


def upper_first(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _lower_first(text: str) -> str:
    return text[:1].lower() + text[1:]
