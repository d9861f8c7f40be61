"""A unit's calibration certificate: what it holds, gathered from the log once; HTML and PDF only lay it out."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from station.domain.line_quality import history
from station.domain.line_quality.history import History
from station.domain.product.device_map import DeviceMap
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.errors import LogError
from station.messages import Message, templates
from station.ports.store import LogHead
from station.reporting.certificate import dcc, facts
from station.reporting.certificate.issue import of_facts
from station.reporting.certificate.issuer import Issuer
from station.reporting.number_text import (
    format_number,
    format_risk,
    format_time,
    format_to_uncertainty,
    written_unit,
)
from station.reporting.words import Words

Rows = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class CertificateTable:
    """A titled table."""

    title: str
    columns: tuple[str, ...]
    rows: Rows


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that stands on a certificate, in one language. number: its own, which each page bears; texts: the
    language's; outcome: PASS or FAIL; simulated: the mark across every page where rig and devices were simulated, else
    ''; statements: declarations; mark: with what else it was made (reporting.certificate.issue)."""

    serial: str
    number: str
    outcome: str
    language: str
    texts: Mapping[str, str]
    sections: tuple[CertificateTable, ...]
    simulated: str = ""
    statements: tuple[str, ...] = ()
    mark: str = ""

    @property
    def title(self) -> str:
        """What it is and of which unit."""
        return f"{self.texts['cert_title']} {self.serial}"


def build(
    stored: Mapping[str, Any],
    recipe: Recipe,
    head: LogHead,
    words: Words,
    issuer: Issuer | None = None,
    issued: str = "",
    receipt: Mapping[str, Any] | None = None,
    device_map: DeviceMap | None = None,
) -> Certificate:
    """The certificate of one ended attempt. stored: everything the log holds of it, with the recipe it used; head: the
    newest record of the log; issued: ISO date; receipt: the witness' newest countersignature. Errors: LogError where it
    came to no calibration."""
    content = facts.of_attempt(
        *(stored, recipe, head, issuer or Issuer(), issued or str(stored["ended"] or stored["started"])[:10]),
        receipt=receipt,
        device_map=device_map,
    )
    fit, verdict = stored_attempt.result(stored, "calibration"), stored_attempt.result(stored, "verdict")
    if not fit or not verdict or fit.get("offset") is None:
        raise LogError("certificate-no-calibration", attempt=str(stored["attempt"]), serial=str(stored["serial"]))
    w, known = _Writer(words), history.of_document(stored_attempt.result(stored, "history"))
    visits = ("cert_position", "cert_tilt", "cert_tilt_u", "cert_residual")
    sections = (
        w.table("certificate-issue", (), _issue(w, content)),
        w.section("cert_unit", (), _unit(w, stored)),
        w.section("cert_result", (), _result(w, content, stored, fit, verdict)),
        w.table("certificate-coefficients", _COEFFICIENTS, _values(w, content)),
        w.table("certificate-decisions", _DECISIONS, _decisions(w, content)),
        w.table("certificate-budget", *_budget(content)),
        w.section("cert_stops", visits, _positions(fit), f" {written_unit(recipe.unit)}"),
        w.section("cert_verification", ("cert_position", "cert_error", "cert_limit"), _verification(stored)),
        w.table("certificate-held", _HELD, _held(w, content)),
        w.table("certificate-adjustment", _ADJUSTMENT, _adjustment(content)),
        w.section("cert_reference", (), _reference(w, recipe)),
        w.table("certificate-traceability", _TRACEABILITY, _traceability(content)),
        w.table("certificate-assumptions", _ASSUMPTIONS, _assumptions(w, recipe, known)),
        w.section("cert_provenance", (), _provenance(w, stored, asdict(head), content)),
    )
    filled = tuple(s for s in sections if s.rows)
    mark = w.render(Message("certificate-simulated-mark")) if content["simulated"] else ""
    declared = tuple(w.render(m) for m in dcc.statements(content))
    made_with = of_facts(content, words.code).mark()
    return Certificate(
        *(stored["serial"], str(content["number"]), str(verdict["outcome"]), words.code, w.texts),
        sections=filled,
        simulated=mark,
        statements=declared,
        mark=made_with,
    )


class _Writer:
    """Words of one language."""

    def __init__(self, words: Words) -> None:
        self.texts, self.term, self.render = words.texts, words.term, words.render

    def __call__(self, key: str, *values: str) -> str:
        """The text `cert_KEY`, with its values."""
        return self.texts[f"cert_{key}"].format(*values)

    def table(self, title: str, columns: Sequence[str], rows: Rows) -> CertificateTable:
        """A table whose title and heads stand in the catalogues; a head that does not is shown as it is."""
        known = templates("en")
        heads = [self.render(Message(f"head-{c}")) if f"head-{c}" in known else self.term(c) for c in columns]
        return CertificateTable(self.render(Message(title)), tuple(heads), rows)

    def section(self, title: str, columns: Sequence[str], rows: Rows, more: str = "") -> CertificateTable:
        """A table with its heads; more: goes behind the last one."""
        heads = [self.texts[c] for c in columns]
        return CertificateTable(
            self.texts[title], tuple(h + more * (i == len(heads) - 1) for i, h in enumerate(heads)), rows
        )


def _unit(w: _Writer, stored: Mapping[str, Any]) -> Rows:
    identity = stored_attempt.result(dict(stored), "identity") or {}
    device = " ".join(str(identity[k]) for k in ("name", "hardware", "software") if identity.get(k))
    return (
        (w("serial"), str(stored["serial"])),
        (w("device"), device or "–"),
        (
            w("measured"),
            f"{format_time(stored['started'])} – {format_time(stored['ended']) if stored['ended'] else '…'}",
        ),
        (w("place"), f"{stored['station']} / {stored['nest']} ({w('node')} {stored['node']})"),
        (w("operator"), str(stored["operator"]) or "–"),
        (w("lot"), str(stored["lot"]) or "–"),
    )


def _temperature(content: Mapping[str, Any]) -> str:
    """With U for 95 %, as the thermometer is known."""
    degrees, wide = content["conditions"]["temperature_degC"], 1.96 * content["conditions"]["temperature_std_degC"]
    shown = f"{format_to_uncertainty(degrees, wide)} °C"
    return f"{shown}, U = {format_to_uncertainty(wide, wide)} °C" if degrees is not None and wide else shown


def _result(
    w: _Writer,
    content: Mapping[str, Any],
    stored: Mapping[str, Any],
    fit: Mapping[str, Any],
    verdict: Mapping[str, Any],
) -> Rows:
    outcome = w.texts[stored["outcome"]] if stored["outcome"] else w("running")
    return (
        (w("outcome"), outcome),
        *((w("reason"), w.render(Message.recorded(r))) for r in verdict["reasons"]),
        (w("rule"), _rule(w, verdict)),
        *((w(key), format_risk(verdict.get(key))) for key in ("false_accept", "false_reject")),
        (w("residual_rms"), f"{format_number(fit['residual_rms'], 3)} {written_unit(fit['budget'][0]['unit'])}"),
        (w("temperature"), _temperature(content)),
        (w("written"), w("yes") if verdict["written"] else w("no")),
        (w("verified"), w("yes") if verdict["verified"] else w("no")),
        *((w("note"), note) for note in _notes(w, fit)),
    )


def _notes(w: _Writer, fit: Mapping[str, Any]) -> tuple[str, ...]:
    """Notes on the calibration; an older log keeps only their sentences."""
    if "note_messages" in fit:
        return tuple(w.render(Message.of(note)) for note in fit["note_messages"])
    return tuple(str(note) for note in fit.get("notes", ()))


def _rule(w: _Writer, verdict: Mapping[str, Any]) -> str:
    """The decision rule; an older log keeps only its sentence."""
    stored = verdict.get("rule_message")
    return w.render(Message.of(stored)) if stored else str(verdict["rule"] or "–")


_COEFFICIENTS = ("coefficient", "value", "std", "dof", "factor", "expanded", "unit")
_DECISIONS = ("limit-of", "value", "expanded", "limit", "guard", "margin", "risk")
_HELD = ("coefficient", "before", "read-back", "difference")
_ADJUSTMENT = ("object", "before", "written", "read-back")
_TRACEABILITY = ("reference", "number", "due", "issuer")
_ASSUMPTIONS = ("contribution", "std", "source")
#: More degrees of freedom than this are as good as infinite.
_MANY_DOF = 1e5


def _values(w: _Writer, content: Mapping[str, Any]) -> Rows:
    return tuple(
        (
            w.term(str(c["name"])),
            format_to_uncertainty(c["value"], c["expanded"]),
            *(_uncertain(c) if c["estimated"] else (w.render(Message("certificate-assumed")), "–", "–", "–")),
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


def _issue(w: _Writer, content: Mapping[str, Any]) -> Rows:
    issuer, missing = content["issuer"], w.render(Message("certificate-not-stated"))
    rows = {
        "number": content["number"],
        "issued": content["issued"],
        "laboratory": ", ".join([name, issuer["laboratory_address"]]) if (name := issuer["laboratory"]["name"]) else "",
        "customer": issuer["customer"]["name"],
        "signatory": issuer["signatory"],
        "method": f"{content['method']['name']}; {content['method']['recipe']}, version {content['method']['version']}",
    }
    return tuple((w.render(Message(f"certificate-{key}")), str(value) or missing) for key, value in rows.items())


def _decisions(w: _Writer, content: Mapping[str, Any]) -> Rows:
    """Value and U to the second digit of U, like the table of coefficients."""
    return tuple(
        (
            w.term(d["what"]) + (f" / {written_unit(d['unit'])}" if d["unit"] != "1" else ""),
            *(format_to_uncertainty(d[key], d["expanded"]) for key in ("value", "expanded")),
            format_number(d["limit"], 6),
            *(format_to_uncertainty(d[key], d["expanded"]) for key in ("guard", "margin")),
            format_risk(d["false_accept"]),
        )
        for d in content["decisions"]
    )


def _budget(content: Mapping[str, Any]) -> tuple[tuple[str, ...], Rows]:
    """Shares of u² by cause, in percent; causes that contribute nothing have no column."""
    estimated = [c for c in content["coefficients"] if c["estimated"]]
    causes = [cause for cause in (estimated[0]["budget"] if estimated else {}) if any(
        c["budget"][cause] > 0.01 * c["std"] for c in estimated)]  # fmt: skip
    rows = tuple(
        (cause, *(f"{100 * (c['budget'][cause] / c['std']) ** 2:.1f}" for c in estimated if c["name"] in _SHOWN))
        for cause in causes
    )
    return ("contribution", *(c["name"] for c in estimated if c["name"] in _SHOWN)), rows


#: The coefficients whose budget a certificate prints; the JSON document has all.
_SHOWN = ("offset x", "offset y", "offset z", "gain x", "gain y", "gain z")


def _held(w: _Writer, content: Mapping[str, Any]) -> Rows:
    """The calibration that the device held before and after, to the second digit of U; nothing where it keeps none."""
    found, left = (content["held"][key] for key in facts.MOMENTS)
    if found is None or left is None:
        return ()
    before, after = ([*h["offset"], *(v for row in h["matrix"] for v in row)] for h in (found, left))
    return tuple(
        (w.term(str(c["name"])), *(format_to_uncertainty(v, c["expanded"]) for v in (old, new, new - old)))
        for c, old, new in zip(content["coefficients"], before, after, strict=True)
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


def _traceability(content: Mapping[str, Any]) -> Rows:
    return tuple((r["item"], r["number"] or "–", r["due"], r["issuer"] or "–") for r in content["references"])


def _assumptions(w: _Writer, recipe: Recipe, known: History) -> Rows:
    keys = ("limits.process", "reproducibility", "residuals")
    learnt = known.messages(known.applied(recipe))
    return (
        *(
            (
                a.key,
                f"{format_number(a.value, 3)} {written_unit(a.unit) if a.unit != '1' else ''}".strip(),
                w.render(a.source),
            )
            for a in assumptions.listing(recipe)
        ),
        *((key, "", w.render(message)) for key, message in zip(keys, learnt, strict=False)),
    )


def _positions(fit: Mapping[str, Any]) -> Rows:
    return tuple(
        (
            *(
                str(p["name"]),
                format_to_uncertainty(p["tilt_deg"], p["tilt_std_deg"]),
                format_to_uncertainty(p["tilt_std_deg"], p["tilt_std_deg"]),
            ),
            "   ".join(format_to_uncertainty(v, fit["residual_rms"]) for v in p["residual"]),
        )
        for p in fit["positions"]
    )


def _verification(stored: Mapping[str, Any]) -> Rows:
    """The error at each position with its U, and the limit."""
    found = stored_attempt.result(dict(stored), "verification")
    if not found:
        return ()
    unit = written_unit(found.get("unit", ""))
    wide = {d["what"]: d["expanded"] for d in found.get("decisions", ())}
    rows = []
    for p in found.get("positions", ()):
        expanded = wide.get(f"verification {p['name']}")
        error = f"{format_to_uncertainty(p.get('error'), expanded)} {unit}"
        if expanded:
            error += f", U = {format_to_uncertainty(expanded, expanded)} {unit}"
        rows.append((str(p["name"]), error, f"{format_number(found.get('limit'), 4)} {unit}"))
    return tuple(rows)


def _reference(w: _Writer, recipe: Recipe) -> Rows:
    reference = recipe.reference
    rows = [(w("source"), w.texts[f"source_{reference.source}"])]
    rows.append((w("magnitude"), f"{format_number(reference.strength(), 8)} {written_unit(recipe.unit)}"))
    rows.append((w("relative"), format_number(reference.relative_std(), 2)))
    if reference.pose_std_deg is not None:
        rows.append((w("direction"), f"{format_number(reference.pose_std_deg, 3)} {w('degrees')}"))
    if reference.site is not None:
        site = reference.site
        rows.append((w("site"), w("at", f"{site.latitude_deg:g}", f"{site.altitude_m:g}")))
    if reference.gold is not None:
        rows += [(w("gold"), reference.gold.serial), (w("due"), reference.gold.due)]
    else:
        rows.append((w("due"), w("constant") if reference.source == "gravity" else w("not_stated")))
    return tuple(rows)


def _provenance(w: _Writer, stored: Mapping[str, Any], head: Mapping[str, Any], content: Mapping[str, Any]) -> Rows:
    seal = stored["seal"]
    return (
        (w("attempt"), str(stored["attempt"])),
        (w("software"), f"station {stored['software']}"),
        (w("recipe"), f"{stored['recipe_name']} {w('version')} {stored['recipe_version']}"),
        (w("recipe_hash"), str(stored["recipe_hash"])),
        (w("config_hash"), str(stored["config_hash"])),
        (w("seal"), f"{seal['number']}:{seal['hash']}" if seal else "–"),
        (w("head"), f"{head['number']}:{head['hash']}"),
        (w("check"), f"station audit --verify --head {head['number']}:{head['hash']}"),
        *_countersigned(w, content["log"]["witness"]),
        *((w(f"signed_{one['meaning']}"), _signatory(one)) for one in content["signatures"]),
    )


def _countersigned(w: _Writer, receipt: Mapping[str, Any] | None) -> Rows:
    if receipt is None:
        return ()
    tree = f"{receipt['size']}:{receipt['root']}"
    witnessed = f"{receipt['place']}, {stored_attempt.utc(receipt['at_ns'])}"
    return ((w("witness"), f"{witnessed}: {tree}, {receipt['signature']}"),)


def _signatory(signature: Mapping[str, Any]) -> str:
    comment = f": {signature['comment']}" if signature["comment"] else ""
    return f"{signature['by']} ({signature['role']}), {stored_attempt.utc(signature['at_ns'])}{comment}"
