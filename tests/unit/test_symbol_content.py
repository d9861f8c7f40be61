"""Labels: what a scanner read → a serial, or a sentence; and the label that is printed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from station.domain.cell.label import zpl
from station.domain.cell.symbol_content import ContentRules, serial_of_symbol
from station.errors import StationError, UsageError

GS, RS, EOT = "\x1d", "\x1e", "\x04"
ISO = f"[)>{RS}06{GS}1PABC-7{GS}SSN0042{GS}Q1{RS}{EOT}"


@pytest.mark.parametrize(
    ("text", "rules", "serial"),
    [
        ("SN0042\r\n", {}, "SN0042"),
        ("]d1SN0042", {}, "SN0042"),
        ("ACME;SN0042;7", {"form": "pattern", "pattern": r"ACME;(?P<serial>[^;]+);\d"}, "SN0042"),
        (f"]d20104012345000009{'17'}271231{'21'}SN0042", {"form": "gs1"}, "SN0042"),
        (f"{GS}21SN0042{GS}0104012345000009", {"form": "gs1", "require": {"01": "04012345000009"}}, "SN0042"),
        (f"10LOT7{GS}3103000500{'21'}SN0042", {"form": "gs1"}, "SN0042"),
        (f"240PART{GS}21SN0042", {"form": "gs1", "serial": "21"}, "SN0042"),
        (ISO, {"form": "iso15434"}, "SN0042"),
        (ISO, {"form": "iso15434", "require": {"1P": "ABC-7"}}, "SN0042"),
        (ISO, {"form": "iso15434", "serial": "1P"}, "ABC-7"),
    ],
)
def test_a_label_bears_its_serial(text: str, rules: dict[str, object], serial: str) -> None:
    assert serial_of_symbol(text, ContentRules.model_validate(rules)) == serial


@pytest.mark.parametrize(
    ("text", "rules", "sentence"),
    [
        ("\r\n", {}, "The label is empty"),
        ("x" * 1001, {}, "more than 1000 characters"),
        ("FOO;SN1", {"form": "pattern", "pattern": "ACME;(?P<serial>.+)"}, "does not match the pattern"),
        ("0104012345", {"form": "gs1"}, "is no GS1 element string"),
        ("ABC", {"form": "gs1"}, "is no GS1 element string"),
        ("0104012345000009", {"form": "gs1"}, "has no field 21"),
        ("21SN1", {"form": "gs1", "require": {"01": "04012345000009"}}, "belongs to another product"),
        (ISO, {"form": "iso15434", "require": {"1P": "XYZ"}}, "Field 1P of the label is 'ABC-7', not 'XYZ'"),
        ("SN0042", {"form": "iso15434"}, "no ISO/IEC 15434 message"),
    ],
)
def test_a_wrong_label_is_named(text: str, rules: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError) as wrong:
        serial_of_symbol(text, ContentRules.model_validate(rules))
    assert sentence in wrong.value.sentence


@pytest.mark.parametrize("pattern", ["(", "SN.*"])
def test_a_pattern_without_a_serial_is_refused(pattern: str) -> None:
    with pytest.raises(ValidationError):
        ContentRules.model_validate({"form": "pattern", "pattern": pattern})


@given(st.text(max_size=60), st.sampled_from(["plain", "gs1", "iso15434"]))
def test_whatever_is_read_gives_a_serial_or_a_sentence(text: str, form: str) -> None:
    try:
        assert serial_of_symbol(text, ContentRules.model_validate({"form": form}))
    except StationError as wrong:
        assert wrong.sentence


@given(st.text(max_size=80))
def test_no_serial_steers_the_printer(serial: str) -> None:
    printed = zpl(serial, "PASS", "record", "A").decode("utf-8")
    assert printed.count("^XA") == printed.count("^XZ") == 1
    assert printed.count("^FD") == 4
    assert "~" not in printed
