"""What was found: verdict, coefficients, decisions, budget, visits, verification, the calibration as found and left."""

from collections.abc import Mapping
from typing import Any

from station.domain.core.types import Outcome
from station.domain.evaluation import verification
from station.domain.methods import coverage
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.messages import Message
from station.reporting.certificate import facts, visit_sections
from station.reporting.certificate.writer import CertificateTable, Rows, SectionWriter
from station.reporting.number_text import (
    format_number,
    format_risk,
    format_to_uncertainty,
    quantity_in,
    written_unit,
)

#: Heads of the two widest tables.
COEFFICIENTS = ("coefficient", "value", "std", "dof", "factor", "expanded", "unit")
DECISIONS = ("limit-of", "value", "expanded", "limit", "guard", "margin", "risk")
_DISTRIBUTION = ("coefficient", "rectangle", "shift", "unit")
_HELD = ("coefficient", "before", "read-back", "difference", "unit")
_ADJUSTMENT = ("object", "before", "written", "read-back")
#: More degrees of freedom than this are as good as infinite.
_MANY_DOF = 1e5
#: Of every coefficient's standard uncertainty: a cause below it has no column in the budget.
_NEGLIGIBLE = 0.01


def result_tables(
    w: SectionWriter, content: Mapping[str, Any], stored: Mapping[str, Any], recipe: Recipe, writes: bool
) -> tuple[CertificateTable, ...]:
    """All of them, in order. content: `facts.of_attempt`; writes: whether the device keeps a calibration."""
    fit, verdict = stored_attempt.result(stored, "calibration"), stored_attempt.result(stored, "verdict")
    assert fit and verdict
    return (
        w.section("cert_result", (), _result(w, content, stored, fit, verdict, writes)),
        w.table("certificate-coefficients", COEFFICIENTS, _values(w, content)),
        w.table("certificate-decisions", DECISIONS, _decisions(w, content)),
        w.table("certificate-budget", *_budget(w, content)),
        w.table("certificate-distribution", _DISTRIBUTION, _distributions(w, content)),
        visit_sections.reading_table(w, content, recipe),
        *([visit_sections.residual_table(w, fit, recipe)] if _has_residuals(fit) else []),
        _verification(w, stored),
        w.table("certificate-held", _HELD, _held(w, content)),
        w.table("certificate-adjustment", _ADJUSTMENT, _adjustment(content)),
    )


def _result(
    w: SectionWriter,
    content: Mapping[str, Any],
    stored: Mapping[str, Any],
    fit: Mapping[str, Any],
    verdict: Mapping[str, Any],
    writes: bool,
) -> Rows:
    rms = fit["residual_rms"]
    residual = f"{format_to_uncertainty(rms, rms)} {written_unit(fit['budget'][0]['unit'])}"
    again = "fails_again" if content["outcome"] == Outcome.PASS else "false_reject"
    return (
        (w("outcome"), w.texts[stored["outcome"]] if stored["outcome"] else w("running")),
        *((w("reason"), w.render(Message.recorded(r))) for r in verdict["reasons"]),
        (w("rule"), _rule(w, verdict)),
        (w("false_accept"), format_risk(content["risks"]["any_false_accept"])),
        (w(again), format_risk(verdict.get("false_reject"))),
        *([(w("residual_rms"), residual)] if _has_residuals(fit) else []),
        (w("temperature"), _temperature(w, content)),
        *(_written(w, verdict) if writes else [(w("written"), w.say("certificate-keeps-nothing"))]),
        *((w("note"), note) for note in _notes(w, fit)),
    )


def _has_residuals(fit: Mapping[str, Any]) -> bool:
    """Whether a reading was left over; an older log does not keep how many."""
    return bool(fit.get("residuals", {"dof": 1})["dof"])


def _temperature(w: SectionWriter, content: Mapping[str, Any]) -> str:
    """With U for 95 %, as the thermometer is known."""
    degrees, k = content["conditions"]["temperature_degC"], coverage.NORMAL
    wide = k * content["conditions"]["temperature_std_degC"]
    if degrees is None:
        return w.say("certificate-not-measured")
    shown = f"{format_to_uncertainty(degrees, wide)} °C"
    return f"{shown}, U = {format_to_uncertainty(wide, wide)} °C (k = {k:.2f})" if wide else shown


def _written(w: SectionWriter, verdict: Mapping[str, Any]) -> Rows:
    return tuple((w(key), w("yes") if verdict[key] else w("no")) for key in ("written", "verified"))


def _notes(w: SectionWriter, fit: Mapping[str, Any]) -> tuple[str, ...]:
    """Notes on the calibration; an older log keeps only their sentences."""
    if "note_messages" in fit:
        return tuple(w.render(Message.of(note)) for note in fit["note_messages"])
    return tuple(str(note) for note in fit.get("notes", ()))


def _rule(w: SectionWriter, verdict: Mapping[str, Any]) -> str:
    """The decision rule; an older log keeps only its sentence."""
    stored = verdict.get("rule_message")
    return w.render(Message.of(stored)) if stored else str(verdict["rule"] or "–")


def _values(w: SectionWriter, content: Mapping[str, Any]) -> Rows:
    return tuple(
        (
            w.term(str(c["name"])),
            format_to_uncertainty(c["value"], c["expanded"]),
            *(_uncertain(c) if c["estimated"] else (w.say("certificate-assumed"), "–", "–", "–")),
            written_unit(str(c["unit"])),
        )
        for c in content["coefficients"]
    )


def _uncertain(c: Mapping[str, Any]) -> tuple[str, str, str, str]:
    dof = c["dof"]
    return (
        format_to_uncertainty(c["std"], c["std"]),
        "–" if dof is None else "∞" if dof > _MANY_DOF else f"{dof:.0f}",
        f"{c['k']:.2f}",
        format_to_uncertainty(c["expanded"], c["expanded"]),
    )


def _distributions(w: SectionWriter, content: Mapping[str, Any]) -> Rows:
    """What the error of a coefficient has beside Student's t, where it has."""
    return tuple(
        (
            w.term(str(c["name"])),
            *(format_to_uncertainty(c[name], c[name]) if c[name] else "–" for name in facts.DISTRIBUTION),
            written_unit(str(c["unit"])),
        )
        for c in content["coefficients"]
        if any(c.get(name) for name in facts.DISTRIBUTION)
    )


def _decisions(w: SectionWriter, content: Mapping[str, Any]) -> Rows:
    """Value and U to the second digit of U, like the table of coefficients."""
    return tuple(
        (
            _limited(w, d),
            *(format_to_uncertainty(d[key], d["expanded"]) for key in ("value", "expanded")),
            format_number(d["limit"], 6),
            *(format_to_uncertainty(d[key], d["expanded"]) for key in ("guard", "margin")),
            format_risk(d["false_accept"]),
        )
        for d in content["decisions"]
    )


def _limited(w: SectionWriter, decision: Mapping[str, Any]) -> str:
    """What a limit is on, and in which unit: of a gain its deviation from 1, of residuals the largest; of a
    verification its position stays as the recipe names it."""
    what, unit = decision["what"], decision["unit"]
    kind, _, position = what.partition(" ")
    if what in facts.GAIN_NAMES:
        return f"{w.term(what)} − 1"
    if what == "residual":
        name = w("largest_residual")
    else:
        name = f"{w.term(kind)} {position}" if kind == verification.WHAT else w.term(what)
    return name if unit == "1" else quantity_in(name, unit)


def _budget(w: SectionWriter, content: Mapping[str, Any]) -> tuple[tuple[str, ...], Rows]:
    """Shares of u² in percent, a row a coefficient; causes that contribute nothing have no column."""
    estimated = [c for c in content["coefficients"] if c["estimated"]]
    causes = [cause for cause in (estimated[0]["budget"] if estimated else {}) if any(
        c["budget"][cause] > _NEGLIGIBLE * c["std"] for c in estimated)]  # fmt: skip
    rows = tuple(
        (w.term(str(c["name"])), *(f"{100 * (c['budget'][cause] / c['std']) ** 2:.1f}" for cause in causes))
        for c in estimated
    )
    return ("coefficient", *causes), rows


def _verification(w: SectionWriter, stored: Mapping[str, Any]) -> CertificateTable:
    """The error at each position with its U and k, and the limit."""
    found = stored_attempt.result(dict(stored), "verification") or {}
    unit = written_unit(found.get("unit", ""))
    wide = {d["what"]: d["expanded"] for d in found.get("decisions", ())}
    heads = (w("position"), w("error"), w.say("head-expanded"), w.say("head-factor"), w("limit"), w("unit_of"))
    rows = []
    for p in found.get("positions", ()):
        expanded, std = wide.get(f"verification {p['name']}"), p.get("std")
        rows.append(
            (
                str(p["name"]),
                *(format_to_uncertainty(value, expanded) for value in (p.get("error"), expanded)),
                f"{expanded / std:.2f}" if expanded and std else "–",
                format_number(found.get("limit"), 4),
                unit,
            )
        )
    return w.section("cert_verification", heads, tuple(rows))


def _held(w: SectionWriter, content: Mapping[str, Any]) -> Rows:
    """The calibration that the device held before and after, to the second digit of U; nothing where it keeps none."""
    found, left = (content["held"][key] for key in facts.MOMENTS)
    if found is None or left is None:
        return ()
    before, after = ([*h["offset"], *(v for row in h["matrix"] for v in row)] for h in (found, left))
    return tuple(
        (
            w.term(str(c["name"])),
            *(format_to_uncertainty(v, c["expanded"]) for v in (before[i], after[i], after[i] - before[i])),
            written_unit(str(c["unit"])),
        )
        for c in content["coefficients"]
        for i in [c["index"]]
        if c["estimated"]
    )


def _adjustment(content: Mapping[str, Any]) -> Rows:
    """Objects of the device as found and as left, as bytes on the bus; of the stages of one write the last."""
    last: dict[tuple[str, str], tuple[int, Mapping[str, Any]]] = {}
    for number, a in enumerate(content["adjustment"]):
        earlier = last.get((a["name"], a["object"]), (number, {}))
        same = earlier[1].get("written") == a["written"]
        last[a["name"], a["object"]] = (earlier[0] if same else number, a)
    return tuple(
        (f"{a['name']} ({a['object']})", *(str(a[key] or "–") for key in ("old", "written", "read_back")))
        for _, a in sorted(last.values(), key=lambda pair: pair[0])
    )
