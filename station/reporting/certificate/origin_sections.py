"""Where a result comes from: issuer, item, reference, traceability, assumptions, the record in the log."""

from collections.abc import Mapping
from typing import Any

from station.domain.line_quality.history import History
from station.domain.recipe import assumptions
from station.domain.recipe.assumptions import Assumption
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.reporting.certificate import facts
from station.reporting.certificate.issuer import Party
from station.reporting.certificate.writer import CertificateTable, Rows, SectionWriter
from station.reporting.number_text import format_number, format_time, format_to_uncertainty, written_unit

_TRACEABILITY = ("reference", "number", "due", "issuer")
_ASSUMPTIONS = ("contribution", "std", "source")
#: What says how well the size of the stimulus is known.
_MAGNITUDE = ("reference.site", "reference.gravimeter", "reference.magnitude_std")


def issue(w: SectionWriter, content: Mapping[str, Any]) -> CertificateTable:
    """Number, date, laboratory and customer with their addresses, signatory, method."""
    issuer, missing, method = content["issuer"], w.say("certificate-not-stated"), content["method"]
    rows = {
        "number": content["number"],
        "issued": f"{content['issued']} UTC",
        **({"replaced": content["replaces"]} if content["replaces"] else {}),
        "laboratory": _named(issuer["laboratory"]),
        "place": w.say(f"place-{issuer['place'].lower()}"),
        "customer": _named(issuer["customer"]),
        "signatory": issuer["signatory"],
        "method": f"{method['name']}; {w('recipe')} {method['recipe']}, {w('version')} {method['version']}",
    }
    listed = tuple((w.say(f"certificate-{key}"), str(value) or missing) for key, value in rows.items())
    return w.table("certificate-issue", (), listed)


def _named(party: Mapping[str, Any]) -> str:
    """Name and address; '' without a name."""
    return ", ".join([party["name"], Party(**party).address]) if party["name"] else ""


def item(w: SectionWriter, stored: Mapping[str, Any]) -> CertificateTable:
    """The unit, when and where it was measured, by whom."""
    identity = stored_attempt.result(dict(stored), "identity") or {}
    device = " ".join(str(identity[k]) for k in ("name", "hardware", "software") if identity.get(k))
    ended = format_time(stored["ended"]) if stored["ended"] else "…"
    rows = (
        (w("serial"), str(stored["serial"])),
        (w("device"), device or "–"),
        (w("measured"), f"{format_time(stored['started'])} – {ended}"),
        (w("place"), f"{stored['station']} / {stored['nest']} ({w('node')} {stored['node']})"),
        (w("operator"), str(stored["operator"]) or "–"),
        (w("lot"), str(stored["lot"]) or "–"),
    )
    return w.section("cert_unit", (), rows)


def origin_tables(
    w: SectionWriter, content: Mapping[str, Any], stored: Mapping[str, Any], recipe: Recipe, known: History
) -> tuple[CertificateTable, ...]:
    """Reference, traceability, assumptions, record. content: `facts.of_attempt`; known: what the log taught."""
    return (
        w.section("cert_reference", (), _reference(w, recipe)),
        w.table("certificate-traceability", _TRACEABILITY, _traceability(content)),
        w.table("certificate-assumptions", _ASSUMPTIONS, _assumptions(w, stored, recipe, known)),
        w.section("cert_provenance", (), _provenance(w, stored, content)),
    )


def _traceability(content: Mapping[str, Any]) -> Rows:
    return tuple((r["item"], r["number"] or "–", r["due"], r["issuer"] or "–") for r in content["references"])


def _assumptions(w: SectionWriter, stored: Mapping[str, Any], recipe: Recipe, known: History) -> Rows:
    keys = ("limits.process", "reproducibility", "residuals")
    learnt, fit = facts.what_log_taught(recipe, known), stored_attempt.result(stored, "calibration")
    listed = facts.assumed(recipe, fit)
    if fit.get("temperature_degC") is not None:
        listed = (*listed, *(a for a in [assumptions.thermometer(recipe)] if a not in listed))
    return (
        *((_contribution(w, a.key), _standard(a), w.render(a.source)) for a in listed),
        *((_contribution(w, key), "–", w.render(message)) for key, message in zip(keys, learnt, strict=False)),
    )


def _contribution(w: SectionWriter, key: str) -> str:
    """A line of the budget, and what the recipe calls it."""
    name = (key.partition(".")[2] or key).replace("_", "-").replace(".", "-").lower()
    return f"{w.say(f'contribution-{name}')} ({key})"


def _standard(a: Assumption) -> str:
    if not (a.stated or a.value) and a.key == "reference.pose_std_deg":
        return "–"  # residuals tell it
    short = format_number(a.value, 3)
    shown = format_to_uncertainty(a.value, a.value) if "e" in short else short
    return f"{shown} {written_unit(a.unit) if a.unit != '1' else ''}".strip()


def _reference(w: SectionWriter, recipe: Recipe) -> Rows:
    """The stimulus and what is known of it. Angles feel no magnitude; rates stand in the positions."""
    reference, rows = recipe.reference, [(w("source"), w.texts[f"source_{recipe.reference.source}"])]
    if reference.source in ("gravity", "field") and not recipe.converts:
        rows.append((w("magnitude"), f"{format_number(reference.strength(), 8)} {written_unit(recipe.unit)}"))
    rows += [
        (w("relative") if a.unit == "1" else w("magnitude_u"), _standard(a))
        for a in assumptions.listing(recipe)
        if a.key in _MAGNITUDE
    ]
    if reference.pose_std_deg is not None:
        rows.append((w("direction"), f"{format_number(reference.pose_std_deg, 3)} {w('degrees')}"))
    if reference.site is not None:
        site = reference.site
        rows.append((w("site"), w("at", f"{site.latitude_deg:g}", f"{site.altitude_m:g}")))
        if recipe.feels_rotation and site.heading_deg is not None:
            rows.append((w("heading"), f"{site.heading_deg:g} {w('degrees')}"))
    if reference.gold is not None:
        rows += [(w("gold"), reference.gold.serial), (w("due"), reference.gold.due)]
    return tuple(rows)


def _provenance(w: SectionWriter, stored: Mapping[str, Any], content: Mapping[str, Any]) -> Rows:
    seal, head = stored["seal"], content["log"]["head"]
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


def _countersigned(w: SectionWriter, receipt: Mapping[str, Any] | None) -> Rows:
    if receipt is None:
        return ()
    tree = f"{receipt['size']}:{receipt['root']}"
    witnessed = f"{receipt['place']}, {stored_attempt.utc(receipt['at_ns'])}"
    return ((w("witness"), f"{witnessed}: {tree}, {receipt['signature']}"),)


def _signatory(signature: Mapping[str, Any]) -> str:
    comment = f": {signature['comment']}" if signature["comment"] else ""
    return f"{signature['by']} ({signature['role']}), {stored_attempt.utc(signature['at_ns'])}{comment}"
