"""A unit's calibration certificate: what it holds, gathered from the log once; HTML and PDF only lay it out."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.errors import LogError
from station.messages import Message
from station.ports.store import LogHead
from station.reporting.number_text import format_number, format_time, format_to_uncertainty
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
    """Everything that stands on a certificate, in one language. texts: that language's; outcome: PASS or FAIL."""

    serial: str
    attempt: str
    outcome: str
    language: str
    texts: Mapping[str, str]
    sections: tuple[CertificateTable, ...]

    @property
    def title(self) -> str:
        """What it is and of which unit."""
        return f"{self.texts['cert_title']} {self.serial}"


def build(kept: Mapping[str, Any], recipe: Recipe, head: LogHead, words: Words) -> Certificate:
    """The certificate of one ended attempt. kept: everything the log holds of it, with the recipe it used; head: the
    newest record of the log. Errors: LogError where it came to no calibration."""
    fit, verdict = stored_attempt.result(kept, "calibration"), stored_attempt.result(kept, "verdict")
    if not fit or not verdict or fit.get("offset") is None:
        raise LogError(
            f"the attempt {kept['attempt']} of {kept['serial']} came to no calibration; it has no certificate"
        )
    w = _Writer(words)
    stops = ("cert_position", "cert_tilt", "cert_tilt_u", "cert_residual")
    sections = (
        w.section("cert_unit", (), _unit(w, kept)),
        w.section("cert_result", (), _result(w, kept, fit, verdict)),
        w.section("cert_calibration", ("cert_coefficient", "cert_value", "", "", "cert_unit_of"), _values(w, fit)),
        w.section("cert_stops", stops, _positions(fit), f" {recipe.unit}"),
        w.section("cert_verification", ("cert_position", "cert_error", "cert_limit"), _verification(kept)),
        w.section("cert_reference", (), _reference(w, recipe)),
        w.section("cert_provenance", (), _provenance(w, kept, asdict(head))),
    )
    filled = tuple(s for s in sections if s.rows)
    return Certificate(kept["serial"], kept["attempt"], str(verdict["outcome"]), words.code, w.texts, filled)


class _Writer:
    """Words of one language."""

    def __init__(self, words: Words) -> None:
        self.texts, self.say, self.render = words.texts, words.say, words.render

    def __call__(self, key: str, *values: str) -> str:
        """The text `cert_KEY`, with its values."""
        return self.texts[f"cert_{key}"].format(*values)

    def section(self, title: str, columns: Sequence[str], rows: Rows, more: str = "") -> CertificateTable:
        """A table with its heads; more: goes behind the last one."""
        heads = [
            self.texts[c] if c else u for c, u in zip(columns, ("", "", "u (k = 1)", "U (k = 2)", ""), strict=False)
        ]
        return CertificateTable(
            self.texts[title], tuple(h + more * (i == len(heads) - 1) for i, h in enumerate(heads)), rows
        )


def _unit(w: _Writer, kept: Mapping[str, Any]) -> Rows:
    identity = stored_attempt.result(dict(kept), "identity") or {}
    device = " ".join(str(identity[k]) for k in ("name", "hardware", "software") if identity.get(k))
    return (
        (w("serial"), str(kept["serial"])),
        (w("device"), device or "–"),
        (w("measured"), f"{format_time(kept['started'])} – {format_time(kept['ended']) if kept['ended'] else '…'}"),
        (w("place"), f"{kept['station']} / {kept['nest']} ({w('node')} {kept['node']})"),
        (w("operator"), str(kept["operator"]) or "–"),
        (w("lot"), str(kept["lot"]) or "–"),
    )


def _result(w: _Writer, kept: Mapping[str, Any], fit: Mapping[str, Any], verdict: Mapping[str, Any]) -> Rows:
    outcome = w.texts[kept["outcome"]] if kept["outcome"] else w("running")
    return (
        (w("outcome"), outcome),
        *((w("reason"), w.render(Message.recorded(r))) for r in verdict["reasons"]),
        (w("rule"), _rule(w, verdict)),
        *((w(key), format_number(verdict.get(key), 3)) for key in ("false_accept", "false_reject")),
        (w("residual_rms"), f"{format_number(fit['residual_rms'], 3)} {fit['budget'][0]['unit']}"),
        (w("temperature"), f"{format_number(fit.get('temperature_degC'), 4)} °C"),
        (w("written"), w("yes") if verdict["written"] else w("no")),
        (w("verified"), w("yes") if verdict["verified"] else w("no")),
        *((w("note"), w.say(str(note))) for note in fit.get("notes", ())),
    )


def _rule(w: _Writer, verdict: Mapping[str, Any]) -> str:
    """The decision rule; an older log keeps only its sentence."""
    kept = verdict.get("rule_message")
    return w.render(Message.of(kept)) if kept else w.say(str(verdict["rule"] or "–"))


def _values(w: _Writer, fit: Mapping[str, Any]) -> Rows:
    theta = [*fit["offset"], *(v for row in fit["matrix"] for v in row)]
    rows = zip(fit["budget"], theta, strict=True)
    return tuple(
        (
            *(w.say(str(b["coefficient"])), format_to_uncertainty(v, b["expanded"])),
            *(
                format_to_uncertainty(b["std"], b["std"]),
                format_to_uncertainty(b["expanded"], b["expanded"]),
                str(b["unit"]),
            ),
        )
        for b, v in rows
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


def _verification(kept: Mapping[str, Any]) -> Rows:
    found = stored_attempt.result(dict(kept), "verification")
    if not found:
        return ()
    limit = f"{format_number(found.get('limit'), 4)} {found.get('unit', '')}"
    return tuple((str(p["name"]), format_number(p.get("error"), 3), limit) for p in found.get("positions", ()))


def _reference(w: _Writer, recipe: Recipe) -> Rows:
    reference = recipe.reference
    rows = [(w("source"), w.texts[f"source_{reference.source}"])]
    rows.append((w("magnitude"), f"{format_number(reference.strength(), 8)} {recipe.unit}"))
    rows.append((w("relative"), format_number(reference.relative_std(), 2)))
    rows.append((w("direction"), f"{format_number(reference.pose_std_deg, 3)} {w('degrees')}"))
    if reference.site is not None:
        site = reference.site
        rows.append((w("site"), w("at", f"{site.latitude_deg:g}", f"{site.altitude_m:g}")))
    if reference.gold is not None:
        rows += [(w("gold"), reference.gold.serial), (w("due"), reference.gold.due)]
    else:
        rows.append((w("due"), w("constant") if reference.source == "gravity" else w("not_stated")))
    return tuple(rows)


def _provenance(w: _Writer, kept: Mapping[str, Any], head: Mapping[str, Any]) -> Rows:
    seal = kept["seal"]
    return (
        (w("attempt"), str(kept["attempt"])),
        (w("software"), f"station {kept['software']}"),
        (w("recipe"), f"{kept['recipe_name']} {w('version')} {kept['recipe_version']}"),
        (w("recipe_hash"), str(kept["recipe_hash"])),
        (w("config_hash"), str(kept["config_hash"])),
        (w("seal"), f"{seal['number']}:{seal['hash']}" if seal else "–"),
        (w("head"), f"{head['number']}:{head['hash']}"),
        (w("check"), f"station audit --verify --head {head['number']}:{head['hash']}"),
    )
