"""Everything a calibration certificate says (ISO/IEC 17025, 7.8), as one document: `station.certificate/1`.

PDF, page, DCC and JSON are made of it, so that they agree to the digit. Values are in the recipe's unit; those of
the DCC are converted there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from station.domain.core.types import Outcome
from station.domain.line_quality import history
from station.domain.line_quality.history import History
from station.domain.methods.coefficients import GAINS, NAMES
from station.domain.product.as_found import Moment, held_calibration
from station.domain.product.device_map import DeviceMap
from station.domain.recipe import assumptions
from station.domain.recipe.assumptions import Assumption
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.domain.records.issued_certificate import Edition, digests_of
from station.errors import LogError
from station.messages import Message, render
from station.ports.store import LogHead
from station.reporting.certificate.issuer import Issuer

SCHEMA = "station.certificate/1"
#: Standard acceleration of free fall, m/s²: what "g" means here.
STANDARD_GRAVITY = 9.80665
#: What the log did not teach, without what the laboratory may do about it.
_TO_CUSTOMERS = {
    "history-no-process": Message("certificate-no-process"),
    "history-no-reproducibility": Message("certificate-no-reproducibility"),
}
#: Coefficients whose nominal value is 1.
GAIN_NAMES = frozenset(name for name, gain in zip(NAMES, GAINS, strict=True) if gain)
#: Of an error that is not Student's t alone (coverage.ErrorDistribution).
DISTRIBUTION = ("rectangle", "shift")
#: What the device held, by what a certificate calls it.
MOMENTS: Mapping[str, Moment] = {"as_found": "old", "as_left": "read_back"}


def of_attempt(
    stored: Mapping[str, Any],
    recipe: Recipe,
    head: LogHead,
    issuer: Issuer,
    edition: Edition,
    receipt: Mapping[str, Any] | None = None,
    device_map: DeviceMap | None = None,
) -> dict[str, Any]:
    """The certificate of one ended attempt; edition: which one of it; receipt: the witness' newest; device_map: how
    the device keeps its calibration. Errors: LogError where it came to no calibration."""
    fit, verdict = stored_attempt.result(stored, "calibration"), stored_attempt.result(stored, "verdict")
    if not fit or not verdict or fit.get("offset") is None:
        raise LogError("certificate-no-calibration", attempt=str(stored["attempt"]), serial=str(stored["serial"]))
    identity = stored_attempt.result(stored, "identity") or {}
    verified = stored_attempt.result(stored, "verification")
    decided = [*fit.get("decisions", []), *(verified or {}).get("decisions", [])]
    known = history.of_document(stored_attempt.result(stored, "history"))
    recipe = known.applied(recipe)
    return {
        "schema": SCHEMA,
        "number": edition.number or first_number(stored),
        "issued": edition.issued,
        "replaces": edition.replaces,
        "changed": list(edition.changed),
        "simulated": stored_attempt.is_simulated(stored["software"]),
        "issuer": {**asdict(issuer), "laboratory_address": issuer.laboratory.address},
        "item": {"serial": stored["serial"], "identity": identity, "lot": stored["lot"]},
        "outcome": verdict["outcome"],
        "performed": {"began": stored["started"], "ended": stored["ended"], "station": stored["station"],
                      "nest": stored["nest"], "operator": stored["operator"]},
        "method": {"name": recipe.method, "recipe": stored["recipe_name"], "version": stored["recipe_version"],
                   "hash": stored["recipe_hash"], "software": stored["software"]},
        "unit": recipe.unit,
        "coefficients": coefficients(fit, recipe.axes),
        "covariance": fit["covariance"],
        "decisions": decided,
        "rule": verdict.get("rule"),
        "risks": {**{key: verdict.get(key) for key in ("false_accept", "false_reject")},
                  "any_false_accept": any_false_accept(verdict, decided)},
        "visits": [visit_of(recipe, p) for p in fit["positions"]],
        "verification": verified,
        "adjustment": _adjustment(stored["writes"]),
        "held": {key: _held(device_map, stored["writes"], moment) for key, moment in MOMENTS.items()},
        "conditions": {
            "temperature_degC": fit.get("temperature_degC"),
            "temperature_std_degC": assumptions.thermometer_degC(recipe),
        },
        "references": references(recipe),
        "assumptions": [
            {"key": a.key, "std": a.value, "unit": a.unit, "stated": a.stated, "source": render(a.source)}
            for a in assumed(recipe, fit)
        ],
        "history": [render(message) for message in what_log_taught(recipe, known)],
        "log": {"attempt": stored["attempt"], "seal": stored["seal"], "head": asdict(head),
                "config": stored["config_hash"], "witness": None if receipt is None else dict(receipt)},
        "signatures": stored_attempt.signatures(stored),
    }  # fmt: skip


def assumed(recipe: Recipe, fit: Mapping[str, Any]) -> tuple[Assumption, ...]:
    """Every contribution as stated or assumed in the budget of that calibration, which may be an older one."""
    listed = assumptions.listing(recipe)
    if not any(b["parts"].get("temperature") for b in fit["budget"]):
        listed = assumptions.at_one_temperature(listed)
    with_power_on = any(b["parts"].get("runs") for b in fit["budget"])
    return listed if with_power_on else assumptions.at_one_power_on(listed)


def _adjustment(writes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What was written to the device; not the key that unlocks it, which is the maker's secret."""
    keys = ("name", "object", "old", "written", "read_back")
    return [{key: write.get(key) for key in keys} for write in writes if write.get("name") != "unlock"]


def visit_of(recipe: Recipe, visit: Mapping[str, Any]) -> dict[str, Any]:
    """One visit: what a perfect device reads there (None where the recipe does not know it), and what was read."""
    keys = ("name", "seating", "run", "disturbed", "temperature_degC")
    own = {key: visit[key][: recipe.axes] for key in ("mean", "std_of_mean")}
    known = recipe.pose_known and recipe.reference.source != "gold"
    true = recipe.true_vector(recipe.position(visit["name"]), visit["seating"]) if known else None
    stimulus = None if true is None else [float(value) for value in true[: recipe.axes]]
    return {**{key: visit.get(key) for key in keys}, "stimulus": stimulus, **own}


def what_log_taught(recipe: Recipe, known: History) -> list[Message]:
    """What the log taught of this recipe, for a customer's eyes."""
    return [_TO_CUSTOMERS.get(message.id, message) for message in known.messages(known.applied(recipe))]


def first_number(stored: Mapping[str, Any]) -> str:
    """Number of an attempt's certificate, as long as nothing on it is changed."""
    return f"{stored['station']}-{stored['attempt']}"


#: Parts of a certificate that are not the attempt's, as `outside_log` names them.
PARTS = (*(part.name for part in fields(Issuer)), "signatures")


def outside_log(issuer: Issuer, stored: Mapping[str, Any]) -> str:
    """Digests of what a certificate says beside the attempt: issuer's words, and signatures so far."""
    return digests_of({**asdict(issuer), "signatures": stored_attempt.signatures(stored)})


def any_false_accept(verdict: Mapping[str, Any], decided: Sequence[Mapping[str, Any]]) -> float | None:
    """At most the probability that anything limited is beyond its limit (Boole): the coefficients together, as the
    verdict has them, and each other value by itself; None where an older log has no risk."""
    together: float | None = verdict.get("false_accept")
    if together is None or verdict["outcome"] != Outcome.PASS:
        return together
    return min(1.0, together + sum(d["false_accept"] or 0.0 for d in decided if d["what"] not in NAMES))


def _held(
    device_map: DeviceMap | None, writes: Sequence[Mapping[str, Any]], moment: Moment
) -> dict[str, list[Any]] | None:
    found = None if device_map is None else held_calibration(device_map, writes, moment)
    return None if found is None else {"offset": found[0].tolist(), "matrix": found[1].tolist()}


def require_certifiable(stored: Mapping[str, Any]) -> None:
    """LogError unless the attempt passed: what failed gets a report, not a certificate."""
    if stored["outcome"] != Outcome.PASS:
        shown = str(stored["outcome"] or "running")
        raise LogError(
            "certificate-not-passed", attempt=str(stored["attempt"]), serial=str(stored["serial"]), outcome=shown
        )


def coefficients(fit: Mapping[str, Any], axes: int = 3) -> list[dict[str, Any]]:
    """Value, u, ν_eff, k and U of each coefficient of the axes that the device has; index: its place among the twelve.
    An older record keeps no ν_eff, and its U is 1.96·u; one before rules 9 knows Student's t only."""
    theta = [*fit["offset"], *(v for row in fit["matrix"] for v in row)]
    return [
        {
            "index": i,
            "name": b["coefficient"],
            "unit": b["unit"],
            "value": value,
            "estimated": b["std"] > 0,
            "std": b["std"],
            "dof": b.get("dof"),
            "k": b.get("k", 1.96),
            "expanded": b["expanded"],
            "coverage_probability": b.get("coverage_probability", 0.95),
            "budget": b["parts"],
            **{name: b[name] for name in DISTRIBUTION if name in b},
        }
        for i, (b, value) in enumerate(zip(fit["budget"], theta, strict=True))
        if max(divmod(i - 3, 3) if i > 2 else (i,)) < axes
    ]


def references(recipe: Recipe) -> list[dict[str, Any]]:
    """What the result is traceable to: item, certificate, due date, issuer."""
    found: list[dict[str, Any]] = [c.model_dump() for c in recipe.reference.certificates]
    gold = recipe.reference.gold
    if recipe.reference.source == "gold" and gold is not None:
        found.append({"item": f"gold {gold.serial}", "number": gold.certificate, "due": gold.due, "issuer": ""})
    return found


def overdue(recipe: Recipe, day: str) -> Sequence[dict[str, Any]]:
    """References past their due date on that ISO day."""
    return [r for r in references(recipe) if r["due"] < day[:10]]
