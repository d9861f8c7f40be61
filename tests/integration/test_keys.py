"""Keys of the log: encrypted, in a hardware module, handed over, lost, revoked."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store import keys
from station.adapters.store.log_anchors import Acknowledgement
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import ConfigError, StoreFault
from station.ports.log_reader import Trust
from station.wiring.logs import signer_of
from tests.fakes import logs
from tests.fakes.command import captured

sys.path.insert(0, str(Path(__file__).parents[1] / "vcan"))
from vcan_harness import debian


def key_file(path: Path, passphrase: bytes = b"") -> Path:
    how = serialization.BestAvailableEncryption(passphrase) if passphrase else serialization.NoEncryption()
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, how)
    path.write_bytes(Ed25519PrivateKey.generate().private_bytes(*pem))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "station.db"


@pytest.fixture
def first(tmp_path: Path) -> keys.Signer:
    return keys.load_signer(key_file(tmp_path / "first.key"))


@pytest.fixture
def second(tmp_path: Path) -> keys.Signer:
    return keys.load_signer(key_file(tmp_path / "second.key"))


def found(path: Path, trusted: bytes | None = None) -> list[tuple[str, str]]:
    with SqliteLogReader(path) as log:
        return [(f.what, f.message.id) for f in log.findings(Trust(public_key=trusted))]


def test_an_encrypted_key_opens_with_its_passphrase_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = key_file(tmp_path / "station.key", b"correct horse")
    for wrong in ("", "battery staple"):
        monkeypatch.setenv("STATION_KEY_PASSPHRASE", wrong)
        with pytest.raises(ConfigError, match="is encrypted and could not be opened"):
            signer_of(str(file))
    monkeypatch.setenv("STATION_KEY_PASSPHRASE", "correct horse")
    signer = signer_of(str(file))
    assert keys.verify(signer.public_key, signer.sign(b"seal"), b"seal")


def test_a_key_that_the_old_one_signed_takes_over_whichever_is_trusted(
    path: Path, first: keys.Signer, second: keys.Signer
) -> None:
    with SqliteStore(path, signer=first) as store:
        logs.unit(store)
    SqliteStore(path, signer=second, old_signer=first).close()
    with SqliteStore(path, signer=second) as store:
        logs.unit(store, "SN2")
    for trusted in (None, first.public_key, second.public_key):
        assert found(path, trusted) == []
    stranger = Ed25519PrivateKey.generate().public_key().public_bytes_raw()
    assert {what for what, _ in found(path, stranger)} == {"forged"}


def test_another_key_without_the_old_ones_word_is_refused_and_never_trusted(
    path: Path, first: keys.Signer, second: keys.Signer
) -> None:
    with SqliteStore(path, signer=first) as store:
        logs.unit(store)
    with pytest.raises(StoreFault, match="the station has another one: hand it over"):
        SqliteStore(path, signer=second)
    with pytest.raises(StoreFault, match="names no signing_key"):
        SqliteStore(path)
    with SqliteStore(path, signer=second, acknowledgement=Acknowledgement("Ada", "the old key is lost")) as store:
        logs.unit(store, "SN2")
    assert found(path) == []
    with SqliteLogReader(path) as log:
        assert [f["what"] for a in log.acknowledgements() for f in a["findings"]] == ["key-changed"]
    assert ("forged", "key-changed-unsigned") in found(path, first.public_key)


def test_what_a_revoked_key_signed_later_is_forged(path: Path, first: keys.Signer, second: keys.Signer) -> None:
    with SqliteStore(path, signer=first) as store:
        logs.unit(store)
        good = store.head().number
        logs.unit(store, "SN2")
        last = store.head().number
    with SqliteStore(path, signer=second, old_signer=first) as store:
        store.event("", keys.REVOKED_EVENT, {"public_key": first.public_key.hex(), "beyond": good})
    forged = found(path, second.public_key)
    assert forged == [("forged", "record-forged")] * (last - good)


def test_the_command_rotates_and_the_run_goes_on(
    path: Path, tmp_path: Path, first: keys.Signer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = Path("config.yaml")
    text = "schema: station.config/1\nnests: [{name: A, node: 17}]\nsigning_key: first.key\ntrusted_key: first.key\n"
    config.write_text(text)
    key_file(Path("next.key"))

    run = ("run", "--simulate", "--units", "1", "--recipe", "one-point")
    assert captured(*run).returncode == 0
    assert captured("key", "rotate", "--to", "next.key").returncode == 0
    refused = captured(*run)
    assert (refused.returncode, refused.stderr.count("\n")) == (3, 1)
    config.write_text(text.replace("signing_key: first.key", "signing_key: next.key"))
    assert captured(*run).returncode == 0
    checked = captured("audit", "--verify")
    assert (checked.returncode, "is whole" in checked.stdout) == (0, True)
    for wrong in (("rotate",), ("revoke",), ("burn",)):
        answer = captured("key", *wrong)
        assert (answer.returncode, answer.stderr.count("\n")) == (2, 1)


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, str]]:
    """SoftHSM's library with a token that holds an Ed25519 key, and the environment in which it finds it."""
    program = debian.provide(["softhsm2-util"])["softhsm2-util"]
    root = program.parents[2]
    (library,) = {p.resolve() for p in (root / "usr" / "lib").rglob("libsofthsm2.so")}
    folder = tmp_path_factory.mktemp("softhsm")
    (folder / "tokens").mkdir()
    (folder / "softhsm2.conf").write_text(f"directories.tokendir = {folder / 'tokens'}\n")
    environment = {"SOFTHSM2_CONF": str(folder / "softhsm2.conf"), "LD_LIBRARY_PATH": debian.library_path()}
    words = ["--init-token", "--free", "--label", "line", "--pin", "1234", "--so-pin", "5678", "--module", str(library)]
    subprocess.run([program, *words], check=True, capture_output=True, env={**os.environ, **environment})
    code = """
import sys, pkcs11
from pkcs11.util.ec import encode_named_curve_parameters
token = pkcs11.lib(sys.argv[1]).get_token(token_label="line")
with token.open(rw=True, user_pin="1234") as session:
    curve = {pkcs11.Attribute.EC_PARAMS: encode_named_curve_parameters("1.3.101.112")}
    parameters = session.create_domain_parameters(pkcs11.KeyType.EC_EDWARDS, curve, local=True)
    parameters.generate_keypair(mechanism=pkcs11.Mechanism.EC_EDWARDS_KEY_PAIR_GEN, store=True, label="log")
"""
    subprocess.run([sys.executable, "-c", code, str(library)], check=True, env={**os.environ, **environment})
    return str(library), environment


def test_a_key_that_never_leaves_its_module_signs_the_log(
    tmp_path: Path, module: tuple[str, dict[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    library, environment = module
    for name, value in {**environment, "STATION_PKCS11_MODULE": library, "STATION_PKCS11_PIN": "1234"}.items():
        monkeypatch.setenv(name, value)
    signer = signer_of("pkcs11:token=line;object=log")
    assert keys.verify(signer.public_key, signer.sign(b"seal"), b"seal")
    path = tmp_path / "station.db"
    with SqliteStore(path, signer=signer) as store:
        logs.unit(store)
    assert found(path, signer.public_key) == []
    for wrong, sentence in (
        ("pkcs11:object=log", "does not name a key"),
        ("pkcs11:token=other;object=log", "does not give out key"),
        ("pkcs11:token=line;object=other", "does not give out key"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            signer_of(wrong)
