"""Certificates as issued: the log holds their SHA-256, so that another version's wording does not make them false."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from station.adapters.store.sqlite import SqliteStore
from station.cli.app import run_command
from station.domain.records.issued_certificate import IssuedFile, digest_of, issued_files
from station.errors import UsageError
from station.panel_protocol.sealing_socket import taking_requests
from station.ports.log_reader import Query
from station.reporting.certificate.pdf import pdf
from station.reporting.words import words_of
from station.service.certificates import certificate_of, seal_issued_files
from station.wiring.logs import open_log
from tests.fakes import fixture_run

CONFIG = "schema: station.config/1\nnests: [{name: A, node: 17}]\n"
CUSTOMER = {"name": "Customer Ltd", "street": "", "city": "", "post_code": "", "country": "DE"}


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An unsigned log of one unit."""
    folder = tmp_path_factory.mktemp("issued")
    (folder / "config.yaml").write_text(CONFIG)
    fixture_run.run(folder, ["SN0001"], config=folder / "config.yaml")
    return folder


@pytest.fixture
def folder(logged: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of its own for each test, as working directory."""
    own = Path(shutil.copytree(logged, tmp_path / "own"))
    monkeypatch.chdir(own)
    yield own


def known(database: Path) -> list[tuple[int, IssuedFile]]:
    with open_log(database) as log:
        return issued_files(log.attempt(log.attempts(Query(serial="SN0001"))[0]))


def issue(*words: str) -> None:
    assert run_command(["certificate", "SN0001", *words, "--db", "station.db"]) == 0


def check(name: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    capsys.readouterr()
    code = run_command(["certificate", "--check", name, "--db", "station.db"])
    return code, capsys.readouterr().out


def test_every_file_is_sealed_with_number_format_and_hash(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    issue("--pdf", "c.pdf", "--xml", "c.xml", "--json", "c.json", "--wsjf", "c.wsjf")
    facts = json.loads((folder / "c.json").read_text())
    found = known(folder / "station.db")
    assert [(f.format, f.number, f.sha256) for _, f in found] == [
        (kind, facts["number"], digest_of((folder / f"c.{kind}").read_bytes()))
        for kind in ("pdf", "xml", "json", "wsjf")
    ]
    for kind, name in {"pdf": "PDF", "xml": "DCC", "json": "JSON"}.items():
        code, shown = check(f"c.{kind}", capsys)
        assert (code, f"the {name} that was issued" in shown, "otherwise" in shown) == (0, True, False), shown
        assert "compare it yourself" not in shown, "the log has its bytes, date and laboratory with them"


def test_what_an_earlier_version_issued_stays_good(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An earlier version had other words: its file is not what this version makes, but the log knows it."""
    issue("--json", "new.json", "--xml", "new.xml")
    document = json.loads((folder / "new.json").read_text())
    document["statement"] = "As it was worded once."
    old = json.dumps(document).encode()
    (folder / "old.json").write_bytes(old)
    code, shown = check("old.json", capsys)
    assert (code, "holds 1 JSON file as issued" in shown, "statement: the certificate says" in shown) == (2, True, True)
    sealed = {"number": document["number"], "format": "json", "sha256": digest_of(old), "issued": "2026-01-02"}
    with SqliteStore(folder / "station.db", "station-1") as store:
        seal_issued_files(store, document["log"]["attempt"], [{**sealed, "software": "0.1.0"}])
    code, shown = check("old.json", capsys)
    assert (code, "issued on 2026-01-02 by version 0.1.0" in shown) == (0, True), shown
    assert "writes it otherwise in 1 place" in shown
    (folder / "old.json").write_bytes(old.replace(b"PASS", b"FAIL"))
    assert check("old.json", capsys)[0] == 2


def test_a_run_that_holds_the_log_seals_what_is_issued_meanwhile(folder: Path) -> None:
    with SqliteStore(folder / "station.db", "station-1") as store, taking_requests(store, folder / "station.db"):
        issue("--json", "c.json")
    assert [f.sha256 for _, f in known(folder / "station.db")] == [digest_of((folder / "c.json").read_bytes())]


def test_a_log_that_takes_nothing_still_gives_certificates(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Somebody else has it open and seals nothing for others: the file is written, and why it is not sealed is said."""
    with SqliteStore(folder / "station.db", "station-1"):
        issue("--json", "c.json")
    assert "does not hold the SHA-256 of these files" in capsys.readouterr().err
    assert known(folder / "station.db") == []
    assert check("c.json", capsys)[0] == 0


def test_another_copy_than_the_issued_ones_is_named_as_such(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its contents are the log's, its date and laboratory those that were issued."""
    issue("--xml", "c.xml")
    with SqliteStore(folder / "station.db", "station-1"):
        issue("--xml", "other.xml")
    code, shown = check("other.xml", capsys)
    assert (code, "holds 1 DCC file as issued for this attempt; this is another one" in shown) == (0, True), shown
    assert "compare it yourself" not in shown


def configured(**changed: str) -> None:
    """Writes what the laboratory says of itself."""
    said = {"customer": "Customer Ltd", "signatory": "A. Metrologist", "place": "laboratory"} | changed
    block = f"certificate:\n  laboratory: {{name: Example Ltd}}\n  customer: {{name: {said['customer']}}}\n"
    Path("config.yaml").write_text(CONFIG + block + f"  signatory: {said['signatory']}\n  place: {said['place']}\n")


def test_another_customer_makes_another_certificate_which_names_the_one_it_replaces(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configured()
    issue("--pdf", "1.pdf", "--json", "1.json")
    first = json.loads((folder / "1.json").read_text())
    configured(customer="Another Ltd", place="customer")
    issue("--json", "2.json", "--xml", "2.xml")
    second = json.loads((folder / "2.json").read_text())
    assert second["number"] == first["number"] + "-2" and second["replaces"] == first["number"]
    assert second["changed"] == ["customer", "place"]
    xml = (folder / "2.xml").read_text()
    assert f"<dcc:replacedUniqueIdentifier>{first['number']}<" in xml and "<dcc:performanceLocation>customer<" in xml
    assert "; changed: Customer, Place of calibration." in xml
    issue("--pdf", "2.pdf")
    configured()
    issue("--json", "1b.json")
    assert json.loads((folder / "1b.json").read_text())["number"] == first["number"], "a copy of the first"
    for name in ("1.pdf", "1.json", "2.json", "2.xml", "2.pdf", "1b.json"):
        assert check(name, capsys)[0] == 0, name
    (folder / "1b.json").write_text(json.dumps(json.loads((folder / "1b.json").read_text())))
    code, shown = check("1b.json", capsys)
    assert code == 0 and "this is another one" in shown
    assert "compare it yourself" not in shown, "customer and date are those that were issued"


def test_what_an_older_log_does_not_know_is_stated_by_who_amends(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An earlier version kept no digests of what a certificate says: what another one changes, a person must say."""
    with open_log(folder / "station.db") as log:
        attempt = log.attempts(Query(serial="SN0001"))[0].attempt
    sealed = {"number": f"station-1-{attempt}", "format": "pdf", "sha256": "0" * 64, "issued": "2026-01-02"}
    with SqliteStore(folder / "station.db", "station-1") as store:
        seal_issued_files(store, attempt, [{**sealed, "software": "0.1.0"}])
    configured()
    for wrong in ([], ["--changed", "colour"]):
        with pytest.raises(UsageError, match=f"{sealed['number']}.*--changed"):
            issue("--json", "2.json", *wrong)
        assert not Path("2.json").exists()
    issue("--json", "2.json", "--changed", "customer, place")
    for name in ("2.json", "copy.json"):
        issue("--json", name)
        copied = json.loads((folder / name).read_text())
        assert copied["replaces"] == sealed["number"] and copied["changed"] == ["customer", "place"]
        assert check(name, capsys)[0] == 0, name


def test_the_page_s_copy_of_an_issued_certificate_is_good(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It names no laboratory and no customer."""
    configured()
    issue("--pdf", "c.pdf")
    with open_log(folder / "station.db") as log:
        shown = certificate_of(log, log.attempts(Query(serial="SN0001"))[0], words_of("en"))
    (folder / "page.pdf").write_bytes(pdf(shown))
    assert check("page.pdf", capsys)[0] == 0


def test_an_issuer_or_day_that_was_not_issued_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    configured()
    issue("--json", "c.json")
    edit: dict[str, Any]
    for edit, words in (
        ({"issuer": {"customer": {**CUSTOMER, "name": "Somebody else"}}}, "another entry: Customer"),
        ({"issuer": {"signatory": "Nobody"}}, "another entry: Responsible"),
        ({"issued": "2031-01-01"}, "not as it was issued on"),
        ({"number": "mine-7"}, "no certificate mine-7"),
        ({"replaces": "mine-7"}, "not as it was issued on"),
    ):
        facts = json.loads((folder / "c.json").read_text())
        for key, value in edit.items():
            facts[key] = {**facts[key], **value} if isinstance(value, dict) else value
        (folder / "e.json").write_text(json.dumps(facts, ensure_ascii=False, indent=1))
        code, shown = check("e.json", capsys)
        assert code == 2 and words in shown, shown


def test_an_accreditation_needs_what_it_stands_on(folder: Path) -> None:
    configured()
    text = Path("config.yaml").read_text() + "  accreditation: D-K-1\n"
    Path("config.yaml").write_text(text)
    with pytest.raises(UsageError, match=r"reference\.certificates"):
        issue("--json", "c.json")


def test_a_dcc_with_entities_or_a_torn_one_is_no_certificate(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    issue("--xml", "c.xml")
    text = (folder / "c.xml").read_text()
    head, _, rest = text.partition("\n")
    (folder / "entity.xml").write_text(f'{head}\n<!DOCTYPE l [<!ENTITY a "x">]>\n{rest.replace(">station<", ">&a;<")}')
    (folder / "torn.xml").write_text(text[:-40])
    for name in ("entity.xml", "torn.xml"):
        with pytest.raises(UsageError, match="no certificate that this program can check"):
            check(name, capsys)


def test_two_formats_want_two_files(folder: Path) -> None:
    with pytest.raises(UsageError, match="named for two formats"):
        issue("--pdf", "c.out", "--json", "c.out")
    assert not (folder / "c.out").exists()
