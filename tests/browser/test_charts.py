"""The charts as an engineer uses them: choose units by a drag, drill down from a reason."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.browser.chrome import Browser
from tests.browser.conftest import Site
from tests.browser.judge import judged
from tests.fakes import fixture_run

pytestmark = pytest.mark.timeout(240)
UNITS = 12
_SHOWN = "[...document.querySelectorAll('#list tr')].filter((row) => !row.hidden)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with three loads; the second unit's y axis is stuck."""
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, units=UNITS, faults=("SN0002/stuck-axis:value=2",))
    return made


def test_a_drag_chooses_units_and_a_reason_leads_to_its_units(
    serve: Callable[..., Site], log_in: Callable[..., Browser], axe: str, folder: Path, pictures: Path
) -> None:
    site = serve(folder=folder)
    page = log_in(site, "emil", size=(1920, 1080))
    page.go(f"{site.url}/charts?value=gain+z")
    assert judged(page, axe) == []
    judged_units = int(page.text("#chosen"))
    assert judged_units >= UNITS - 1
    page.drag("#units .brush", -150, 150)
    page.wait(f"{_SHOWN}.length < {judged_units}")
    numbers = page.script(f"return {_SHOWN}.map((row) => Number(row.dataset.number))")
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert [str(numbers[0]), str(numbers[-1])] == page.script(
        "return ['first', 'last'].map((id) => document.getElementById(id).value)"
    )
    assert len(numbers) == page.script(
        "return document.querySelectorAll('#diagnose input[data-number]:enabled').length"
    )
    page.picture(pictures / "charts.png")
    page.click(".pareto a rect + rect")
    page.wait("location.pathname === '/audit' && document.querySelector('#check').value")
    assert "SN0002" in page.text("tbody")
    assert page.script("return document.querySelectorAll('tbody tr').length") == 1
