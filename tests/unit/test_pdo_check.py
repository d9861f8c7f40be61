"""Messages of a DBC against the PDO mapping of an EDS, and values of a DCF in place of an EDS' defaults."""

from dataclasses import replace
from pathlib import Path

import pytest

from station.adapters.canopen import eds
from station.config.search_path import shipped_folder
from station.domain.can.sensor_layout import SensorLayout
from station.domain.product.pdo_check import pdo_mismatches
from station.errors import ProductError
from station.messages import render
from station.wiring.jobs import check_product

EXAMPLES = shipped_folder() / "dbc" / "examples"
PRODUCTS = [*(shipped_folder() / "dbc").glob("*.yaml"), *EXAMPLES.glob("*.yaml")]


def sentences(layout: SensorLayout, name: str = "dis-qg65") -> list[str]:
    product, _, _ = check_product(str(EXAMPLES / f"{name}.yaml"))
    dictionary = eds.load(EXAMPLES / f"{name}.eds", 1, frozenset())
    return [render(m) for m in pdo_mismatches(layout, product.map, dictionary)]


def changed(signal: str, **more: object) -> SensorLayout:
    """The layout of the DIS QG65, one signal of its message otherwise."""
    _, layout, _ = check_product(str(EXAMPLES / "dis-qg65.yaml"))
    signals = tuple(replace(s, **more) if s.name == signal else s for s in layout.sample.signals)  # type: ignore[arg-type]
    return replace(layout, sample=replace(layout.sample, signals=signals))


@pytest.mark.parametrize("path", PRODUCTS, ids=lambda path: path.stem)
def test_every_shipped_product_agrees_with_its_eds(path: Path) -> None:
    check_product(str(path))


@pytest.mark.parametrize(
    ("signal", "more", "says"),
    [
        ("Y", {"start": 8}, "ends inside it"),
        ("Z", {"start": 48}, "where the PDO maps nothing"),
        ("X", {"signed": False}, "differ in sign"),
        ("X", {"big_endian": True, "start": 7}, "most significant byte first"),
    ],
)
def test_a_signal_that_lies_elsewhere_is_named(signal: str, more: dict[str, object], says: str) -> None:
    (found,) = sentences(changed(signal, **more))
    assert says in found
    assert signal in found


def test_a_message_of_another_length_is_named() -> None:
    _, layout, _ = check_product(str(EXAMPLES / "dis-qg65.yaml"))
    (found,) = sentences(replace(layout, sample=replace(layout.sample, length=8)))
    assert found == "message READINGS has 8 bytes in the DBC, its PDO 6"


def test_a_product_whose_frames_contradict_its_eds_is_refused(tmp_path: Path) -> None:
    for end in ("yaml", "eds", "dbc"):
        text = (EXAMPLES / f"dis-qg65.{end}").read_text(encoding="utf-8")
        (tmp_path / f"dis-qg65.{end}").write_text(
            text.replace(" SG_ Y : 16|16@1-", " SG_ Y : 16|16@1+"), encoding="utf-8"
        )
    with pytest.raises(
        ProductError, match=r"dis-qg65.dbc contradicts the PDO mapping of dis-qg65.eds: signal Y .* differ in sign"
    ):
        check_product(str(tmp_path / "dis-qg65.yaml"))


def test_a_dcf_says_what_the_device_was_configured_to(tmp_path: Path) -> None:
    text = (EXAMPLES / "dis-qg65.eds").read_text(encoding="utf-8")
    before, section, after = text.partition("[1017]")
    after = after.replace("DefaultValue=0\n", "DefaultValue=0\nParameterValue=$NODEID+100\n", 1)
    (tmp_path / "unit.dcf").write_text(before + section + after, encoding="utf-8")
    plain, configured = (eds.load(p, 5, frozenset()) for p in (EXAMPLES / "dis-qg65.eds", tmp_path / "unit.dcf"))
    assert plain[0x1017, 0].default == 0
    assert configured[0x1017, 0].default == 105
    assert {at for at in plain.entries if plain[at].default != configured[at].default} == {(0x1017, 0)}
