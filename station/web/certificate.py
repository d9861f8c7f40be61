"""A unit's calibration certificate: what it holds, gathered from the log once; HTML and PDF only lay it out."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from station.adapters.store import life
from station.adapters.store.reader import LogReader
from station.adapters.store.search import Attempt
from station.domain.recipe import Recipe
from station.errors import LogError
from station.web.render import number


@dataclass(frozen=True, slots=True)
class Section:
    """A titled table."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that stands on a certificate."""

    serial: str
    outcome: str
    sections: tuple[Section, ...]


def build(log: LogReader, attempt: Attempt) -> Certificate:
    """The certificate of one ended attempt. Errors: LogError where it came to no calibration."""
    kept = log.attempt(attempt)
    fit, verdict = life.result(kept, "calibration"), life.result(kept, "verdict")
    if not fit or not verdict or fit.get("offset") is None:
        raise LogError(
            f"the attempt {attempt.attempt} of {attempt.serial} came to no calibration; it has no certificate"
        )
    recipe = Recipe.model_validate_json(log.recipe_and_product(attempt)[0])
    sections = (
        Section("Unit", ("", ""), _unit(kept)),
        Section("Result", ("", ""), _result(kept, fit, verdict)),
        Section("Calibration: measured = matrix · true + offset", _VALUES, _values(fit)),
        Section("Stops", ("position", "tilt, degrees", "u, degrees", f"residual x y z, {recipe.unit}"), _stops(fit)),
        Section("Verification through the device's own output", ("position", "error", "limit"), _verification(kept)),
        Section("Reference", ("", ""), _reference(recipe)),
        Section("Where this comes from", ("", ""), _provenance(kept, asdict(log.head()))),
    )
    return Certificate(attempt.serial, str(verdict["outcome"]), tuple(s for s in sections if s.rows))


_VALUES = ("coefficient", "value", "u (k = 1)", "U (k = 2)", "unit")


def _unit(kept: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    identity = life.result(dict(kept), "identity") or {}
    device = " ".join(str(identity[k]) for k in ("name", "hardware", "software") if identity.get(k))
    return (
        ("serial number", str(kept["serial"])),
        ("device", device or "–"),
        ("measured", f"{kept['started']} to {kept['ended'] or '–'}"),
        ("station / nest", f"{kept['station']} / {kept['nest']} (node {kept['node']})"),
        ("operator", str(kept["operator"]) or "–"),
        ("lot", str(kept["lot"]) or "–"),
    )


def _result(kept: Mapping[str, Any], fit: Mapping[str, Any], verdict: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    risks = [("probability of false accept", "false_accept"), ("probability of false reject", "false_reject")]
    return (
        ("outcome", str(kept["outcome"] or "still running")),
        *(("reason", str(r["sentence"])) for r in verdict["reasons"]),
        ("decision rule", str(verdict["rule"] or "–")),
        *((name, number(verdict.get(key), 3)) for name, key in risks),
        ("residual, root mean square", number(fit["residual_rms"], 3)),
        ("temperature", f"{number(fit.get('temperature_degC'), 4)} °C"),
        ("written to the device, read back bit for bit", "yes" if verdict["written"] else "no"),
        ("verified after restart", "yes" if verdict["verified"] else "no"),
        *(("note", str(note)) for note in fit.get("notes", ())),
    )


def _values(fit: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    theta = [*fit["offset"], *(v for row in fit["matrix"] for v in row)]
    rows = zip(fit["budget"], theta, strict=True)
    return tuple(
        (str(b["coefficient"]), number(v, 7), number(b["std"], 2), number(b["expanded"], 2), str(b["unit"]))
        for b, v in rows
    )


def _stops(fit: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    def residual(values: Sequence[float]) -> str:
        return "  ".join(number(v, 2) for v in values)

    return tuple(
        (str(p["name"]), number(p["tilt_deg"], 3), number(p["tilt_std_deg"], 2), residual(p["residual"]))
        for p in fit["positions"]
    )


def _verification(kept: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    found = life.result(dict(kept), "verification")
    if not found:
        return ()
    limit = f"{number(found.get('limit'), 4)} {found.get('unit', '')}"
    return tuple((str(p["name"]), number(p.get("error"), 3), limit) for p in found.get("positions", ()))


def _reference(recipe: Recipe) -> tuple[tuple[str, str], ...]:
    reference = recipe.reference
    rows = [("source", reference.source), ("magnitude", f"{number(reference.strength(), 8)} {recipe.unit}")]
    rows.append(("relative standard uncertainty", number(reference.relative_std(), 2)))
    rows.append(("direction of each position, standard uncertainty", f"{number(reference.pose_std_deg, 3)} degrees"))
    if reference.site is not None:
        site = reference.site
        rows.append(("site", f"latitude {site.latitude_deg:g} degrees, altitude {site.altitude_m:g} m"))
    if reference.gold is not None:
        rows += [("gold reference", reference.gold.serial), ("due for calibration", reference.gold.due)]
    else:
        rows.append(("due for calibration", "a natural constant; nothing falls due"))
    return tuple(rows)


def _provenance(kept: Mapping[str, Any], head: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    seal = kept["seal"]
    return (
        ("attempt", str(kept["attempt"])),
        ("software", f"station {kept['software']}"),
        ("recipe", f"{kept['recipe_name']} version {kept['recipe_version']}"),
        ("recipe SHA-256", str(kept["recipe_hash"])),
        ("configuration SHA-256", str(kept["config_hash"])),
        ("seal of this attempt", f"{seal['number']}:{seal['hash']}" if seal else "–"),
        ("head of the log", f"{head['number']}:{head['hash']}"),
        ("to check", "station audit --verify --head (head of the log)"),
    )
