"""One formula of several campaigns: what they agree on is pooled, what they do not becomes each station's own."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.errors import InputError
from station.model.model_file import ModelEffect, ModelParameter, SizedTerm
from station.model.pooling import FoundFormula, pool
from tests.unit.test_formula_effect_file import MODEL, code, loaded

TREE = {"input": "own-squared", "modulator": "temperature", "unit": "1/(g·degC)"}


def campaign(
    name: str, values: dict[str, float], std: float | None = 1e-6, of: str = "common", about: float = 25.0, **tree: str
) -> FoundFormula:
    """A campaign that found c · a² · (T − T₀) on the axes given."""
    rows = tuple(ModelParameter(name="coefficient", axis=axis, of=of, value=v, std=std) for axis, v in values.items())
    term = {
        **TREE, **tree, "axes": list(values), "of": of.partition(":")[0], "constants": {"about_degC": about},
        "source": f"found in data {name * 4}, d 16; not yet explained",
    }  # fmt: skip
    return FoundFormula(
        f"{name}.yaml", ModelEffect.model_validate({"effect": "formula-1", "parameters": rows, "term": term})
    )


def test_campaigns_that_agree_are_weighted_by_their_precision() -> None:
    made = pool([campaign("aaaa", {"z": 2.0e-5}, std=1e-6), campaign("bbbb", {"z": 2.1e-5}, std=2e-6)])
    (c,) = made.coefficients
    assert c.value == pytest.approx((2.0e-5 * 4 + 2.1e-5) / 5)
    assert c.std == pytest.approx(1e-6 * 0.8**0.5)
    assert made.agrees and made.term.of == "common" and c.between == 0.0
    assert made.source == "found in 2 campaigns, data aaaaaaaa, bbbbbbbb"


def test_campaigns_that_disagree_give_each_station_its_own_size() -> None:
    values = (2.0e-5, 3.0e-5, 1.0e-5)
    made = pool([campaign(name * 4, {"z": v}) for name, v in zip("abc", values, strict=True)])
    assert not made.agrees and made.term.of == "station"
    (c,) = made.coefficients
    # Equal standard deviations: τ² is the scatter of the values less their own variance (Paule & Mandel, eq. 8).
    assert c.between == pytest.approx((np.var(values, ddof=1) - 1e-12) ** 0.5, rel=1e-6)
    assert made.sizes[0] < made.size < made.sizes[1]


def test_the_pooled_interval_covers_what_all_campaigns_share() -> None:
    rng, hits, rounds = np.random.default_rng(7), 0, 400
    for _ in range(rounds):
        std = rng.uniform(0.5e-6, 3e-6, 5)
        found = [campaign(f"{i:04x}", {"z": float(rng.normal(2e-5, s))}, std=float(s)) for i, s in enumerate(std)]
        (c,) = pool(found).coefficients
        hits += abs(c.value - 2e-5) <= 1.96 * c.std
    # Five standard deviations of a binomial about 95 %; τ² ≥ 0 only widens.
    assert hits / rounds > 0.95 - 5 * (0.95 * 0.05 / rounds) ** 0.5


def test_axes_that_only_one_campaign_saw_are_kept() -> None:
    made = pool([campaign("aaaa", {"z": 2e-5}), campaign("bbbb", {"x": 1e-5, "z": 2e-5})])
    assert made.term.axes == ("x", "z")
    assert [c.axis for c in made.coefficients] == ["x", "z"]


def test_sizes_of_units_are_pooled_as_a_spread() -> None:
    made = pool([campaign(n * 4, {"z": v}, of=f"unit:SN{n}") for n, v in (("a", 3e-5), ("b", -4e-5))])
    assert made.coefficients == () and made.agrees and made.term.of == "unit"
    assert made.size == pytest.approx((12.5e-10 - 1e-12) ** 0.5)


@pytest.mark.parametrize(
    ("other", "problem"),
    [
        (campaign("bbbb", {"z": 2e-5}, input="own-cubed", unit="1/(g²·degC)"), "pool-other-formula"),
        (campaign("bbbb", {"z": 2e-5}, of="unit:SN1"), "pool-other-formula"),
        (campaign("aaaa", {"z": 2e-5}), "pool-same-data"),
        (campaign("bbbb", {"z": 2e-5}, std=None), "pool-without-std"),
    ],
)
def test_what_is_not_one_law_is_refused(other: FoundFormula, problem: str) -> None:
    with pytest.raises(InputError) as refused:
        pool([campaign("aaaa", {"z": 2e-5}), other])
    assert refused.value.message.id == problem


def with_rival(first: FoundFormula, rival: FoundFormula) -> FoundFormula:
    """A campaign that puts one formula first and cannot tell another from it."""
    assert rival.found.term is not None
    form = SizedTerm(parameters=rival.found.parameters, term=rival.found.term)
    return replace(first, found=first.found.model_copy(update={"equivalent": (form,)}))


def test_campaigns_that_put_others_first_are_pooled_by_what_all_hold() -> None:
    cubed: dict[str, Any] = {"input": "own-cubed", "unit": "1/(g²·degC)"}
    one = with_rival(campaign("aaaa", {"z": 2.0e-5}), campaign("aaaa", {"z": 3e-5}, **cubed))
    two = with_rival(campaign("bbbb", {"z": 3.1e-5}, **cubed), campaign("bbbb", {"z": 2.2e-5}))
    size: dict[str, Any] = {"input": "own-size", "unit": "1/degC"}
    three = with_rival(campaign("cccc", {"z": 1e-5}, **size), campaign("cccc", {"z": 2.1e-5}))
    made = pool([one, two, three])
    assert made.term.family == ("own-squared", "temperature")
    assert made.coefficients[0].value == pytest.approx(2.1e-5)
    assert {t.input for t in made.dropped} == {"own-cubed", "own-size"}
    assert pool([one, campaign("dddd", {"z": 2.0e-5})]).dropped == ()
    with pytest.raises(InputError):
        pool([one, campaign("eeee", {"z": 1e-5}, **size)])


def test_the_command_pools_its_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    models = []
    for name, value in (("aaaa", "2.0e-05"), ("bbbb", "2.2e-05")):
        models.append(tmp_path / f"{name}.yaml")
        text = MODEL.replace("2.0e-05", f"{value}, std: 2.0e-06").replace("1f2e3d4c5b6a7980", name * 4)
        models[-1].write_text(text, encoding="utf-8")
    chosen = [word for m in models for word in ("--model", str(m))]
    assert code(["effects", "--write-hypothesis", "thermal-square", *chosen, "--into", str(tmp_path)]) == 0
    assert "pooled over 2 campaigns" in capsys.readouterr().out
    parameter = loaded(tmp_path / "thermal_square.py").ThermalSquare.parameter
    assert 1.9e-5 < parameter.low < parameter.typical < parameter.high < 2.2e-5
    assert "2 campaigns, data aaaaaaaa, bbbbbbbb" in parameter.source
