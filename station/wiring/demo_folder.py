"""The files of a demonstration: a rehearsal bench, the shipped recipes and products, keys, recordings made by hand."""

import hashlib
import random
import shutil
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.clock import SystemClock
from station.config.search_path import shipped_folder
from station.config.settings import load_settings
from station.domain.core.types import Floats
from station.errors import UsageError
from station.messages import system_reason
from station.wiring.logs import open_store
from station.wiring.plant import new_token

#: Private keys, each with its public half as .pub.
KEYS = ("station", "new", "stolen", "witness")
#: Logs without a unit in them, to try the commands on that change a log's keys.
EMPTY_LOGS = ("line-2.db", "line-3.db")
GRAVITY_MS2 = 9.80665
#: A recording made by hand: readings a second, and how long the unit rests in a pose and is on its way, s.
RATE_HZ, REST_S, MOVE_S = 100.0, 3.0, 1.0
NOISE_MS2, SEED = 0.006, 5
#: The unit in those recordings: measured = matrix · true + offset, m/s².
MATRIX = np.array([[1.012, 0.002, 0.0], [0.0, 0.991, -0.003], [0.001, 0.0, 1.004]])
OFFSET_MS2 = np.array([0.12, -0.21, 0.08])
FACES: Mapping[str, Sequence[float]] = {
    "z-up": (0, 0, 1), "z-down": (0, 0, -1), "x-up": (1, 0, 0), "x-down": (-1, 0, 0), "y-up": (0, 1, 0),
    "y-down": (0, -1, 0),
}  # fmt: skip

#: Address at which the plant of plant.yaml and a station find each other.
PLANT_URL = "http://127.0.0.1:8443"
CONFIG = """\
# yaml-language-server: $schema=schemas/config.json
# A rehearsal bench: bus, rig and devices are simulated, so every command works as on a bench, without one.
schema: station.config/1
station: rehearsal
operator: demo
lot: L-1
bus: {interface: simulated}
rehearsal:
  device_state: devices                    # what the simulated devices have saved, one SERIAL.json each
  faults: ["SN9002/stuck-axis:value=1"]    # the known-bad unit: its y axis stands still
nests:
  - {name: A, node: 0x11}
  - {name: B, node: 0x12}
  - {name: C, node: 0x13}
  - {name: D, node: 0x14}
recipe: six-point
database: station.db
signing_key: station.key
golden: {file: golden.json, every_h: 8760}
certificate:
  laboratory: {name: Example Ltd, street: Main Street 1, city: Bonn, post_code: "53111", country: DE}
  customer: {name: Customer Ltd, city: Zug, country: CH}
  signatory: A. Metrologist
line: {cell: {kind: simulated}, opcua: {port: 4840}, modbus: {port: 5502}}
"""
#: config.yaml with something more: simulated drives that turn the fixture; a plant that gets the log.
DRIVES = "positioner: {kind: cia402}\n"
SHIPPING = f"receivers: [{{url: '{PLANT_URL}', token_file: plant.token}}]\n"
#: PostgreSQL is found by the usual variables, PGHOST and so on.
PLANT = """\
schema: station.plant/1
database: "postgresql:///plant"
stations:
  - {{name: rehearsal, public_key: station.pub, token_sha256: {digest}}}
"""
#: A formula that a diagnosis proposed.
HYPOTHESIS = """\
schema: station.model/1
effects:
- effect: formula-1
  parameters: [{name: coefficient, axis: z, of: common, value: 2.0e-05, unit: 1/(g·degC)}]
  term:
    input: own-squared
    modulator: temperature
    axes: [z]
    of: common
    constants: {about_degC: 25.0}
    unit: 1/(g·degC)
    source: not yet explained
"""
#: An image, and the devices that it is for.
FIRMWARE = """\
schema: station.firmware/1
image: firmware.bin
sha256: {sha256}
version: 2.1.0
identity: {{vendor: 0x000CA1B0, product: 0x00000ACC}}
"""


def create_folder(folder: Path) -> None:
    """Makes the folder and writes all that no command of the tour makes. Errors: UsageError where it is not empty."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise UsageError("demo-folder-not-empty", folder=str(folder))
        _write_files(folder)
    except OSError as exc:
        raise UsageError("demo-folder-not-made", folder=str(folder), why=system_reason(exc)) from exc


def create_empty_logs() -> None:
    """The logs without a unit, in the present folder, signed by its station. Errors: StoreFault."""
    settings = load_settings(Path("config.yaml"))
    for name in EMPTY_LOGS:
        open_store(Path(name), settings, SystemClock().epoch_ns).close()


def _write_files(folder: Path) -> None:
    for name in ("recipes", "dbc", "schemas"):
        shutil.copytree(shipped_folder() / name, folder / name)
    token, digest = new_token()
    texts = {
        "config.yaml": CONFIG,
        "drives.yaml": CONFIG + DRIVES,
        "shipping.yaml": CONFIG + SHIPPING,
        "plant.yaml": PLANT.format(digest=digest),
        "plant.token": token + "\n",
        "hypothesis.yaml": HYPOTHESIS,
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    _write_firmware(folder)
    tighter = (folder / "recipes" / "six-point.yaml").read_text(encoding="utf-8")
    tighter = tighter.replace("name: six-point", "name: six-point-tighter").replace("offset: 0.08", "offset: 0.05")
    (folder / "six-point-tighter.yaml").write_text(tighter.replace("../schemas", "schemas"), encoding="utf-8")
    for name in KEYS:
        _write_key(folder / f"{name}.key")
    _write_recordings(folder)


def _write_firmware(folder: Path) -> None:
    """An image for the simulated accelerometer: its version, then noise."""
    data = b"2.1.0".ljust(16, b"\0") + random.Random(1).randbytes(8176)
    (folder / "firmware.bin").write_bytes(data)
    text = FIRMWARE.format(sha256=hashlib.sha256(data).hexdigest())
    (folder / "firmware.yaml").write_text(text, encoding="utf-8")


def _write_key(path: Path) -> None:
    key = Ed25519PrivateKey.generate()
    pem, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    path.touch(mode=0o600)
    path.write_bytes(key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain))
    public = key.public_key().public_bytes(pem, serialization.PublicFormat.SubjectPublicKeyInfo)
    path.with_suffix(".pub").write_bytes(public)


def _write_recordings(folder: Path) -> None:
    rng = np.random.default_rng(SEED)
    faces = np.array(list(FACES.values()), float)
    spread = rng.normal(size=(24, 3))
    _write_table(folder / "faces.csv", _recorded(faces, rng), stamps=True)
    _write_table(folder / "turned.csv", _recorded(spread / np.linalg.norm(spread, axis=1)[:, None], rng), stamps=True)
    _write_table(folder / "log.txt", _blocks(faces, rng), stamps=False)
    for name, warmer_ms2 in (("cold", 0.0), ("warm", 0.03)):
        _write_matlab(folder / f"{name}.mat", _recorded(faces, rng) + warmer_ms2)
    _write_compass(folder / "compass.csv", rng)
    _write_study(folder / "readings.csv", rng)
    _write_linearity(folder / "linearity.csv", rng)
    for name, up in FACES.items():
        _write_table(folder / f"{name}.csv", _recorded(np.array([up], float), rng), stamps=True)


def _recorded(up: Floats, rng: np.random.Generator) -> Floats:
    """Readings (n, 3), m/s², of a unit that rests with each direction (p, 3) up, and is turned by hand in between."""
    rest, move = round(REST_S * RATE_HZ), round(MOVE_S * RATE_HZ)
    share = (np.arange(move) + 0.5)[:, None] / move
    parts = [np.repeat(up[:1], rest, axis=0)]
    for before, after in pairwise(up):
        over = np.cross(before, after) if abs(before @ after) < 0.99 else np.roll(before, 1)
        way = (1 - share) * before + share * after + 0.8 * np.sin(np.pi * share) * over
        shaken = way / np.linalg.norm(way, axis=1)[:, None] + rng.normal(0, 0.03, (move, 3))
        parts += [shaken, np.repeat(after[None], rest, axis=0)]
    return _readings(np.concatenate(parts), rng)


def _blocks(up: Floats, rng: np.random.Generator) -> Floats:
    """100 readings in each direction (p, 3), without the way between them."""
    return _readings(np.repeat(up, 100, axis=0), rng)


def _readings(true_g: Floats, rng: np.random.Generator) -> Floats:
    clean: Floats = (true_g * GRAVITY_MS2) @ MATRIX.T + OFFSET_MS2
    return clean + rng.normal(0, NOISE_MS2, clean.shape)


def _write_table(path: Path, readings_ms2: Floats, *, stamps: bool) -> None:
    """With a header and stamps in s, or as bare numbers."""
    times_s = (np.arange(len(readings_ms2)) / RATE_HZ)[:, None]
    table = np.hstack([times_s, readings_ms2]) if stamps else readings_ms2
    header = "time [s],ax [m/s2],ay [m/s2],az [m/s2]" if stamps else ""
    np.savetxt(path, table, fmt="%.4f", delimiter=",", header=header, comments="")


def _write_matlab(path: Path, readings_ms2: Floats) -> None:
    from scipy.io import savemat

    names = {f"a{axis}": readings_ms2[:, i] for i, axis in enumerate("xyz")}
    savemat(path, {"t": np.arange(len(readings_ms2)) / RATE_HZ, **names})


def _write_compass(path: Path, rng: np.random.Generator) -> None:
    """A magnetometer turned slowly all round in a field of 49 µT: a reading a pose."""
    turned = rng.normal(size=(300, 3))
    field_ut = 49.0 * turned / np.linalg.norm(turned, axis=1)[:, None]
    readings_ut = field_ut * [1.04, 0.98, 1.08] + [20.0, -35.0, 12.0] + rng.normal(0, 0.3, field_ut.shape)
    np.savetxt(path, readings_ut, fmt="%.2f", delimiter=",", header="mag_x,mag_y,mag_z", comments="")


def _write_linearity(path: Path, rng: np.random.Generator) -> None:
    """Ten readings of each of five references, by a station whose gain is 1 % high."""
    rows = [(r, 1.01 * r + rng.normal(0, 0.002)) for r in (-0.1, -0.05, 0.0, 0.05, 0.1) for _ in range(10)]
    path.write_text("reference,value\n" + "".join(f"{r},{v:.6f}\n" for r, v in rows), encoding="utf-8")


def _write_study(path: Path, rng: np.random.Generator) -> None:
    """Ten parts, three appraisers, three trials of an offset, in g."""
    parts, appraisers = rng.normal(0, 0.03, 10), rng.normal(0, 0.0005, 3)
    lines = ["part,appraiser,trial,value"]
    for p, part in enumerate(parts):
        for a, appraiser in enumerate(appraisers):
            values = part + appraiser + rng.normal(0, 0.0008, 3)
            lines += [f"P{p + 1},{'ABC'[a]},{t + 1},{value:.5f}" for t, value in enumerate(values)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
