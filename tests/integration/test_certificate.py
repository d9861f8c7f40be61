"""`station certificate`: PDF, DCC, JSON and WSJF of a unit that passed; refusals with the way out."""

import importlib
import json
import sqlite3
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from station.reporting.certificate import dcc
from station.reporting.certificate.dcc_elements import DCC
from tests.fakes.command import station

CONFIG = """schema: station.config/1
nests: [{name: A, node: 17}]
certificate:
  laboratory: {name: Test Bench Ltd, street: Main Street 1, city: Bonn, post_code: "53111", country: DE}
  customer: {name: Customer & Sons, city: Zug, country: CH}
  signatory: A. Metrologist
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("certificate")
    (path / "config.yaml").write_text(CONFIG)
    where = ("--db", str(path / "t.db"), "--config", str(path / "config.yaml"))
    assert station("run", "--simulate", "--serial", "SN0001", "--seed", "3", *where) == 0
    return path


def write(folder: Path, *more: str) -> int | str | None:
    db, config = str(folder / "t.db"), str(folder / "config.yaml")
    return station("certificate", "SN0001", "--db", db, "--config", config, *more)


def test_every_format_gives_the_same_figures_and_says_simulated(folder: Path) -> None:
    names = {kind: str(folder / f"c.{kind}") for kind in ("pdf", "xml", "json", "wsjf")}
    assert write(folder, *(word for kind, path in names.items() for word in (f"--{kind}", path))) == 0
    facts = json.loads(Path(names["json"]).read_text())
    assert facts["simulated"] is True
    assert facts["issuer"]["laboratory"]["name"] == "Test Bench Ltd"
    xml = Path(names["xml"]).read_bytes()
    read = dcc.read_quantities(xml)
    for c in facts["coefficients"]:
        factor = 9.80665 if c["unit"] == "g" else 1.0
        assert c["expanded"] == c["k"] * c["std"]
        assert read[c["name"]] == (c["value"] * factor, c["expanded"] * factor), "every bit"
        left = [*facts["held"]["as_left"]["offset"], *np.ravel(facts["held"]["as_left"]["matrix"])][c["index"]]
        assert read[f"{c['name']} as left"] == (left * factor, None)
    for p, d in zip(facts["verification"]["positions"], facts["verification"]["decisions"], strict=True):
        assert read[d["what"]] == (p["error"] * 9.80665, d["expanded"] * 9.80665)
    decided = ET.fromstring(xml).iter(f"{{{DCC}}}metaData")
    assert [m.findtext(f"{{{DCC}}}conformity") for m in decided] == ["pass"] * 16, (
        "12 coefficients, 2 positions, residual and noise"
    )
    assert b"SIMULATED" in xml and b"Customer &amp; Sons" in xml and b"no accredited calibration" in xml
    assert "SIMULATED" in Path(names["wsjf"]).read_text(encoding="utf-8")
    steps = json.loads(Path(names["wsjf"]).read_text())["root"]["steps"]
    assert [s["name"] for s in steps] == [d["what"] for d in facts["decisions"]]
    assert all(s["status"] == "P" for s in steps)
    assert Path(names["pdf"]).read_bytes().startswith(b"%PDF-")


def test_the_calibration_stands_as_found_and_as_left(folder: Path) -> None:
    assert write(folder, "--json", str(folder / "h.json"), "--pdf", str(folder / "h.pdf")) == 0
    facts = json.loads((folder / "h.json").read_text())
    found, left = facts["held"]["as_found"], facts["held"]["as_left"]
    fitted = [c["value"] for c in facts["coefficients"]]
    written = [*left["offset"], *(v for row in left["matrix"] for v in row)]
    # REAL32 rounds to half of 2^-23 of a number near 1.
    assert written == pytest.approx(fitted, rel=1e-6, abs=1e-9)
    assert np.linalg.norm(np.array(found["matrix"]) - np.eye(3)) < 0.2
    assert found["offset"] != left["offset"]


def test_the_dcc_holds_the_countersignature_of_the_witness(folder: Path) -> None:
    assert write(folder, "--json", str(folder / "w.json")) == 0
    facts = json.loads((folder / "w.json").read_text())
    receipt: dict[str, Any] = {
        "place": "witness.example",
        "size": 12,
        "root": "ab" * 32,
        "at_ns": 0,
        "signature": "cd" * 64,
    }
    facts["log"]["witness"] = receipt
    declared = " ".join(map(str, ET.fromstring(dcc.to_xml(facts)).itertext()))
    assert "witness at witness.example on 1970-01-01" in declared and receipt["root"] in declared
    assert receipt["signature"] in declared


def test_the_tree_has_the_order_of_the_schema(folder: Path) -> None:
    assert write(folder, "--xml", str(folder / "o.xml")) == 0
    root = ET.parse(folder / "o.xml").getroot()
    assert root.get("schemaVersion") == "3.3.0"
    inside = [e.tag.split("}")[1] for e in root.find(f"{{{DCC}}}administrativeData") or ()]
    assert inside == [
        *("dccSoftware", "coreData", "items", "calibrationLaboratory", "respPersons", "customer", "statements")
    ]
    result = root.find(f"{{{DCC}}}measurementResults/{{{DCC}}}measurementResult")
    assert [e.tag.split("}")[1] for e in result or ()] == ["name", "usedMethods", "influenceConditions", "results"]


def test_a_changed_digit_breaks_the_signature(folder: Path) -> None:
    etree, signxml = importlib.import_module("lxml.etree"), importlib.import_module("signxml")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "bench")])
    now = datetime.now(UTC)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    cert = builder.serial_number(1).not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=9))
    pem = cert.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)
    plain = serialization.NoEncryption()
    private = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    (folder / "key.pem").write_bytes(private)
    (folder / "cert.pem").write_bytes(pem)
    signing = ("--sign-key", str(folder / "key.pem"), "--sign-cert", str(folder / "cert.pem"))
    assert write(folder, "--xml", str(folder / "s.xml"), *signing) == 0
    signed = (folder / "s.xml").read_bytes()
    signxml.XMLVerifier().verify(etree.fromstring(signed), x509_cert=pem.decode())
    forged = signed.replace(b"<dcc:uniqueIdentifier>", b"<dcc:uniqueIdentifier>9", 1)
    with pytest.raises(signxml.InvalidDigest):
        signxml.XMLVerifier().verify(etree.fromstring(forged), x509_cert=pem.decode())


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ((), "Say what to write"),
        (("--xml", "x.xml", "--dcc-version", "2.0"), "use 3.3.0 or 3.2.1"),
        (("--xml", "x.xml", "--sign-key", "k.pem"), "both --sign-key and --sign-cert"),
        (("--xml", "x.xml", "--attempt", "none"), "SN0001"),
        (("--pdf", "x.pdf", "--language", "fr"), "There is no language 'fr'; choose one of de, en, zh."),
    ],
)
def test_refusals(folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], shown: str) -> None:
    assert write(folder, *words) == 2
    assert shown in capsys.readouterr().err


@pytest.mark.parametrize("country", ["Germany", "de", "D"])
def test_a_country_is_two_letters(
    folder: Path, tmp_path: Path, country: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "config.yaml").write_text(CONFIG.replace("country: DE", f"country: {country}"))
    wanted = ("--config", str(tmp_path / "config.yaml"), "--pdf", str(tmp_path / "c.pdf"))
    assert station("certificate", "SN0001", "--db", str(folder / "t.db"), *wanted) == 2
    assert f"{country!r} is no country code; write the two letters" in capsys.readouterr().err


def test_a_log_that_does_not_verify_certifies_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("t.db", "t.db.head", "config.yaml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with sqlite3.connect(tmp_path / "t.db") as db:
        for (trigger,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            db.execute(f'DROP TRIGGER "{trigger}"')
        db.execute("UPDATE attempt SET lot = 'other'")
    assert write(tmp_path, "--json", str(tmp_path / "c.json")) == 2
    assert not (tmp_path / "c.json").exists()
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--pdf", "none/c.pdf"), "c.pdf cannot be written: no such file or folder"),
        (("--pdf", "."), "cannot be written: it is a folder"),
        (("--xml", "k.xml", "--sign-key", "none.key", "--sign-cert", "none.pem"), "none.key cannot be read"),
        (("--xml", "k.xml", "--sign-key", "config.yaml", "--sign-cert", "config.yaml"), "cannot sign: give an"),
    ],
)
def test_files_that_cannot_be_are_one_sentence_and_leave_nothing(
    folder: Path, words: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    placed = [word if word.startswith("--") else str(folder / word) for word in words]
    assert write(folder, *placed) == 2
    assert sentence in capsys.readouterr().err
    assert not (folder / "k.xml").exists()
