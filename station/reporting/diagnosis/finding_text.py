"""The finding in words: one sentence a person on the line can act on."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.reporting.diagnosis.cause_text import cause_text
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.quantity_format import display_unit, format_significant, format_size

CauseDocument = Mapping[str, Any]

#: Verdict → symbol and words of its badge.
BADGES = {
    "none": ("✔", "nothing found"),
    "named": ("▲", "cause found"),
    "incomplete": ("◐", "cause found, but not all of it"),
    "unknown": ("?", "something unknown"),
}
#: The words of `unknown.depends_on`, as a person says them.
KERNEL_TEXTS = {
    "time": "the time within the run",
    "position": "the position",
    "temperature": "the temperature",
    "input": "the size and direction of the stimulus",
    "dwell-phase": "the time since arrival at a stop",
    "order": "the order of the stops",
    "unit": "the unit and its run",
    "group": "the station, nest, lot or operator",
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
    checked = len(data.document["considered"])
    return FirstScreen(
        "Nothing is wrong that these data could show: the simulation accounts for "
        f"{count_noun(counts['visits'], 'stop')} "
        f"of {count_noun(counts['units'], 'unit')} to {rms} {unit} rms, "
        f"where the noise floor alone makes {floor} {unit}.",
        f"Nothing needs doing. {count_noun(checked, 'cause was', 'causes were')} looked for; how small an effect "
        "of each would have been seen stands below.",
    )


def _unknown(data: ReportData) -> FirstScreen:
    base = data.document["baseline"]
    factor, unit = display_unit([base["residual_rms"], data.noise_rms], base["unit"])
    return FirstScreen(
        f"Something is wrong that no known cause explains; it depends on {describe_dependence(data)}. The residual is "
        f"{format_significant(base['residual_rms'] * factor)} {unit} rms where noise alone makes "
        f"{format_significant(data.noise_rms * factor)} {unit}.",
        next_run_sentence(data) or f"Look at what changes with {describe_dependence(data)}; the picture shows how.",
    )


def _cause_screen(data: ReportData) -> FirstScreen:
    cause = leading_cause(data)
    also = [c["effect"] for c in data.causes if c is not cause]
    parts = [f"{describe_cause(cause)}{describe_size(cause, data)}; {describe_cost(cause, data)}"]
    if also:
        parts.append(f" {count_noun(len(also), 'more cause was', 'more causes were')} found: {', '.join(also)}")
    if data.document["verdict"] == "incomplete":
        parts.append(f" What is left depends on {describe_dependence(data)}")
    return FirstScreen(".".join(parts) + ".", _advice(cause, data))


def _advice(cause: CauseDocument, data: ReportData) -> str:
    """What to do about a cause; about each that it may be, where the data cannot tell and no next run would."""
    members = [cause["effect"], *cause["indistinguishable_from"]]
    if len(members) > 1 and (data.document.get("next_run") or {}).get("separates"):
        return next_run_sentence(data)
    told = [(name, do) for name in members[:3] if (do := cause_text(name).do)]
    text = "; ".join(f"if it is {name}: {do}" for name, do in told) if len(members) > 1 else "".join(d for _, d in told)
    return _upper_first(f"{text}.") if text else ""


def leading_cause(data: ReportData) -> CauseDocument:
    """The cause that explains most of what is wrong; the one found first where several do."""
    return max(data.causes, key=_explained_square)


def _explained_square(cause: CauseDocument) -> float:
    """By how much knowing a cause lowers the mean square; nothing where it moves no mean."""
    before, after = cause["gain"]["rms_before"], cause["gain"]["rms_after"]
    return 0.0 if before is None else float(before**2 - after**2)


def describe_cause(cause: CauseDocument) -> str:
    """What the cause is; all that it may be where the data cannot tell."""
    others = cause["indistinguishable_from"]
    if not others:
        return cause_text(cause["effect"]).physics
    names = " or ".join([cause["effect"], *others])
    return f"{names}: these data cannot tell which. The likeliest: {_lower_first(cause_text(cause['effect']).physics)}"


def describe_size(cause: CauseDocument, data: ReportData) -> str:
    """Size and who has it, from the parameters."""
    rows = main_parameters(cause)
    numbers = [row for row in rows if not isinstance(row["value"], str)]
    if not rows:
        return ""
    if not numbers:
        return f" ({rows[0]['value']} on {describe_affected(cause, data).removesuffix(', each its own')})"
    largest = max(numbers, key=lambda row: abs(row["value"]))
    told = format_size(abs(largest["value"]), largest["unit"])
    up_to = "up to " if len(numbers) > 1 else ""
    return f", by {up_to}{told} on {describe_affected(cause, data)}"


def main_parameters(cause: CauseDocument) -> list[Mapping[str, Any]]:
    """The rows of the cause's coefficient, without those of its form."""
    rows: Sequence[Mapping[str, Any]] = cause["parameters"]
    return [row for row in rows if row["name"] == rows[0]["name"]]


def describe_affected(cause: CauseDocument, data: ReportData) -> str:
    """Who is affected, in words."""
    groups = list(dict.fromkeys(str(row["of"]) for row in main_parameters(cause)))
    kind = groups[0].split(":", 1)[0]
    names = [g.split(":", 1)[-1] for g in groups]
    if kind == "common":
        units = data.document["data"]["units"]
        return "every unit alike" if units > 1 else "this unit"
    if kind == "unit":
        total = data.document["data"]["units"]
        return f"unit {names[0]}" if len(names) == 1 else f"{len(names)} of {total} units, each its own"
    if kind in ("visit", "run"):
        serial, run, *visit = names[0].rsplit("/", 2 if kind == "visit" else 1)
        one = f"unit {serial}, run {run}" + (f", stop {visit[0]}" if visit else "")
        return one if len(names) == 1 else f"{count_noun(len(names), _noun(kind))} (first: {one})"
    return (
        f"{kind} {names[0]}" if len(names) == 1 else f"{len(names)} {kind}s ({', '.join(names[:3])}{_ellipsis(names)})"
    )


def describe_cost(cause: CauseDocument, data: ReportData) -> str:
    """What the cause costs, and what knowing it gains on data that were not fitted."""
    unit = data.unit_of_readings
    parts = [_held_out_cost(cause["gain"], unit)]
    moved = largest_shift(data)
    if moved is not None and moved[1] > 0.2 * (cause["gain"]["rms_before"] or 0.0):
        parts.append(f"it moves the calibration of {moved[0]} by {format_size(moved[1], unit)} rms")
    if (v := data.judged) is not None and v["passed_after"] != v["passed_before"]:
        total, before, after = len(v["units"]), v["passed_before"], v["passed_after"]
        parts.append(f"without it {after} of {total} units would pass instead of {before}")
    return ", and ".join(part for part in parts if part)


def _held_out_cost(gain: Mapping[str, Any], unit: str) -> str:
    """What knowing a cause gains on data that were not fitted; "" where nobody measured it."""
    if gain["log_score"] is None:
        return ""
    if gain["rms_before"] is None:
        return f"each {gain['per']} not fitted is {format_significant(gain['log_score'])} nats likelier with it"
    factor, words = display_unit([gain["rms_before"], gain["rms_after"]], unit)
    before, after = format_significant(gain["rms_before"] * factor), format_significant(gain["rms_after"] * factor)
    if gain["rms_after"] < gain["rms_before"]:
        return f"knowing it brings the error on stops not fitted from {before} to {after} {words} rms"
    return f"it leaves {before} {words} rms that no correction takes away"


def largest_shift(data: ReportData) -> tuple[str, float] | None:
    """The unit whose calibrated readings the causes move most, and by how much, recipe's unit; None where not known."""
    if data.line is None:
        return None
    worst = max(data.line["units"], key=lambda u: u["moves"])
    return worst["serial"], worst["moves"] / 1e3


def describe_dependence(data: ReportData) -> str:
    """What the unexplained rest depends on."""
    return " and ".join(KERNEL_TEXTS.get(w, w) for w in data.document["unknown"]["depends_on"])


def next_run_sentence(data: ReportData) -> str:
    """The next run as a sentence, empty where none is proposed."""
    run = data.document.get("next_run")
    if not run:
        return ""
    separates = run.get("separates") or []
    if not separates and run["recipe_change"].startswith("no run"):
        return "No change of this recipe that the station knows of would tell them apart."
    if not separates:
        return f"Another run of this kind would not help. What would: {run['recipe_change']}."
    certainty = run.get("certainty")
    sure = "" if certainty is None else f", right in {math.floor(100 * certainty)} of 100 cases as predicted"
    told = f"{', '.join(separates[:-1])} and {separates[-1]} apart" if len(separates) > 2 else " from ".join(separates)
    return (
        f"To be sure, measure again with {run['recipe_change']} ({format_significant(run['minutes'], 2)} minutes), "
        f"which tells {told}{sure}."
    )


def count_noun(count: int, one: str, several: str = "") -> str:
    """A count with its noun, in the singular where there is one."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def _noun(kind: str) -> str:
    return "stop" if kind == "visit" else kind


def _ellipsis(names: Sequence[str]) -> str:
    return " …" if len(names) > 3 else ""


def _upper_first(text: str) -> str:
    return text[:1].upper() + text[1:]


def _lower_first(text: str) -> str:
    return text[:1].lower() + text[1:]
