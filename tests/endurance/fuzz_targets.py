"""More readers for torture_input.py and torture_fuzz.py: what lies beside the log, keys, plans of a rig, recordings of
others, bodies of requests, answers of devices. Each has a good input that it takes.

A reader whose contract is ValueError, or "nothing" for what cannot be read, counts as refusing.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from starlette.testclient import TestClient

from station.adapters.annotations import read_marks
from station.adapters.canopen import eds
from station.adapters.canopen.lss_master import LSS_ANSWER, LSS_REQUEST, CanopenLssMaster
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_client import SdoClient
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.store import keys
from station.adapters.witness.head_file import TreeHeadFile
from station.config.documents import load_document, validate
from station.config.line import LineSettings
from station.config.plant import load_plant
from station.config.rigs import load_rig
from station.config.search_path import shipped_folder
from station.config.settings import load_settings
from station.domain.cell.symbol_content import ContentRules, serial_of_symbol
from station.domain.core.types import Frames
from station.domain.recipe.recipe import Recipe
from station.domain.recognition.raw_table import RawTable
from station.domain.records import wire
from station.domain.records.chain import canonical
from station.domain.records.framepack import codec
from station.domain.records.head import SealedHead
from station.domain.records.tree_head import TreeHead
from station.errors import ConfigError, InputError, StationError
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.answer import read_answer
from station.panel_protocol.companion import Companion
from station.panel_protocol.journal import Journal
from station.panel_protocol.line_adjustment import LineAdjustments
from station.panel_protocol.line_state import LineCommands, read_line_state
from station.panel_protocol.live_state import expected_s
from station.panel_protocol.owner import owner_pid
from station.panel_protocol.questions import Questions
from station.panel_protocol.queue import LoadQueue
from station.service import golden_register
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions, RunLauncher
from station.web.screen import Screen
from station.wiring.alerts import read_book
from station.wiring.jobs import load_job
from station.wiring.raw_tables import raw_tables
from station.wiring.shipping import read_statuses
from tests.fakes.scripted_channel import ScriptedChannel


@dataclass(frozen=True, slots=True)
class Target:
    """Something that reads. good: an input that it takes; name: the file's; read: takes the path."""

    good: bytes
    name: str
    read: Callable[[Path], object]


def further_targets(folder: Path) -> Mapping[str, Target]:
    """By name. folder: for what the good inputs are made of."""
    return {**_documents(), **_beside_the_log(), **_records(), **_recordings(folder), **_bodies(folder), **_answers()}


def _documents() -> dict[str, Target]:
    shipped = shipped_folder()
    eds_text = (shipped / "dbc" / "accelerometer.eds").read_bytes()
    line = b"cell: {kind: simulated}\nscan_s: 2\n"
    plant = b"schema: station.plant/1\ndatabase: postgresql:///plant\nstations: []\n"
    dcf = eds_text + b"\n[DeviceComissioning]\nNodeID=5\nBaudrate=500\n"
    return {
        "rig": Target((shipped / "rigs" / "two-axis.yaml").read_bytes(), "rig.yaml", lambda p: load_rig(str(p))),
        "line": Target(line, "line.yaml", lambda p: validate(load_document(p, ConfigError), LineSettings, ConfigError)),
        "plant": Target(plant, "plant.yaml", load_plant),
        "dcf": Target(dcf, "a.dcf", lambda p: eds.load(p, 5)),
        "marks": Target(_MARKS, "m.marks.json", read_marks),
        "marks.csv": Target(_MARKS_CSV, "m.marks.csv", read_marks),
        "label": Target(b"[)>\x1e06\x1dSSN0001\x1dP123\x1e\x04", "label", _label),
    }


_MARKS = b"""{"marks": [{"unit": "SN1", "node": 5, "run": 0, "visit": 0, "position": "z", "start_s": 0, "end_s": 1}]}"""
_MARKS_CSV = b"unit,node,run,visit,position,start_s,end_s\nSN1,5,0,0,z-up,0.0,1.0\n"


def _label(path: Path) -> object:
    text = path.read_bytes().decode("latin-1")
    rules = (ContentRules(), ContentRules(form="gs1", serial="21"), ContentRules(form="iso15434", serial="S"))
    for each in rules:
        try:
            serial_of_symbol(text, each)
        except InputError:
            continue
    return None


def _beside_the_log() -> dict[str, Target]:
    """Files by which a run and the page find each other, and registers of one station."""
    lasting = {"schema": "station.alerts/1", "lasting": [], "entries": [], "issued": []}
    shipped = {"receiver": "plant", "state": "shipping", "number": 3, "newest": 4, "since_ns": 0, "sent_ns": 0}
    states: dict[str, tuple[object, Companion, Callable[[Path], object]]] = {
        "queue": ({"waiting": {"A": {"serial": "SN1"}}, "handed": {}, "pid": 7}, Companion.QUEUE, _queue),
        "answer": ({"schema": "station.answer/1", "question": "7"}, Companion.ANSWER, read_answer),
        "line-state": ({"schema": "station.line/1"}, Companion.LINE, read_line_state),
        "line-command": ({"number": 3, "command": "Start"}, Companion.LINE_COMMAND, lambda d: LineCommands(d).next()),
        "line-adjustment": ({"number": 3, "mode": "produce", "times_s": {"scan_s": 2.0}}, Companion.LINE_ADJUSTMENT,
                            lambda d: LineAdjustments(d).next()),
        "questions": ({"schema": "station.questions/1", "questions": {"q": {"serial": "S"}}}, Companion.QUESTIONS,
                      lambda d: Questions(d.with_name("s.db.questions.json")).all()),
        "owner": ({"name": "bench", "pid": 3, "started_ns": 5}, Companion.OWNER, owner_pid),
        "alerts": (lasting, Companion.ALERTS, read_book),
        "shipping": ({"receivers": [{**shipped, "refused": 0, "message": None}]}, Companion.SHIPPING, read_statuses),
        "live": ({"schema": "station.live/1", "recipe": {}, "expected_s": [1.0]}, Companion.LIVE, _live),
    }  # fmt: skip
    person = {"name": "ada", "role": "engineer", "password": "scrypt$2$8$1$AAAA$AAAA"}
    people = {"schema": "station.accounts/1", "accounts": [person]}
    unit = asdict(golden_register.by_certificate("SN9", ["gain z=1.0053:0.002"], "2035-06-30"))
    rows = {
        name: Target(json.dumps(document).encode(), f"s.db{ending.value}", partial(_beside, read))
        for name, (document, ending, read) in states.items()
    }
    return rows | {
        "journal": Target(_JOURNAL, "s.db.panel.jsonl", lambda p: list(Journal(p).lines())),
        "accounts": Target(json.dumps(people).encode(), "accounts.json", accounts.load),
        "golden": Target(json.dumps({"units": [unit]}).encode(), "golden.json", golden_register.load),
        "device-state": Target(b'{"objects": {"2101:01": 1.5}}', "SN1.json", lambda p: NonVolatileMemory(p).objects),
    }


_JOURNAL = json.dumps({"person": "ada", "deed": "log-in", "detail": {}, "previous": "0" * 64}).encode() + b"\n"


def _beside(read: Callable[[Path], object], path: Path) -> object:
    return read(path.with_name("s.db"))


def _queue(database: Path) -> object:
    return LoadQueue(database.with_name("s.db.queue.json")).waiting


@cache
def _recipe() -> Recipe:
    job, _ = load_job("six-point")
    return job.recipe


def _live(database: Path) -> object:
    return expected_s(database, _recipe())


def _records() -> dict[str, Target]:
    """Heads, keys, and records on their way."""
    key = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    public = key.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    head = SealedHead("log", "bench-1", 7, "ab" * 32, "cd" * 64)
    tree = TreeHead("log", "bench-1", 7, "ab" * 32, "ab" * 32, "cd" * 64, "ef" * 32, "01" * 64)
    body = canonical("finish", ("attempt", "outcome", "ended_ns"), (1, "PASS", 5))
    record = wire.WireRecord(1, bytes(32), bytes(64), body)
    frames = Frames(
        np.arange(9) * 10**7, np.full(9, 0x185, np.uint32), np.full(9, 8, np.uint8), np.zeros((9, 8), np.uint8)
    )
    line = json.dumps({"at_ns": 1, "replaces": "", "head": tree.document()}).encode() + b"\n"
    return {
        "head": Target(head.line().encode(), "s.db.head", lambda p: _valued(lambda: SealedHead.parse(_text(p)))),
        "tree-heads": Target(line, "heads.jsonl", _tree_heads),
        "key": Target(private, "station.key", keys.load_signer),
        "public-key": Target(public, "station.pub", keys.load_public_key),
        "portion": Target(wire.encode([record]), "portion", lambda p: _valued(lambda: _portion(p.read_bytes()))),
        "frame-archive": Target(codec.pack([frames]), "archive", lambda p: codec.unpack(p.read_bytes())),
    }


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8", "replace")


def _valued(read: Callable[[], object]) -> object:
    """Of a reader whose contract is ValueError."""
    try:
        return read()
    except ValueError:
        return None


def _portion(data: bytes) -> object:
    return [wire.parse(record.body) for record in wire.decode(data)]


def _tree_heads(path: Path) -> object:
    file = TreeHeadFile(path)
    try:
        file.open()
        return file.of_station("bench-1")
    finally:
        file.close()


def _recordings(folder: Path) -> dict[str, Target]:
    """Tables of others; what is compressed is read in a process of its own."""
    from scipy.io import savemat

    savemat(folder / "good.mat", {"t": np.arange(30) / 100, "acc": np.ones((30, 3))})
    table = b"time,ax,ay,az\n" + b"".join(b"%d,0.1,0.2,1.0\n" % n for n in range(30))
    return {
        "table": Target(table, "t.csv", _raw),
        "mat": Target((folder / "good.mat").read_bytes(), "t.mat", _raw),
    }


def _raw(path: Path) -> list[RawTable]:
    return raw_tables(path, None)


def _bodies(folder: Path) -> dict[str, Target]:
    """Bodies of requests to the page, of a person who is logged in; whatever comes, it is no fault of the page."""
    page = _Page(folder / "page")
    form = b"action=scan&nest=A&serial=SN0001&csrf=" + page.csrf.encode()
    nest = {"nest": "A", "serial": "SN1", "outcome": "", "phase": "measure", "reasons": []}
    live = {"schema": "station.live/1", "pid": 7, "state": {"began_s": 1.0, "nests": [nest]}}
    return {
        "http-body": Target(form, "body", page.post),
        "screen": Target(json.dumps(live).encode(), "s.db.live.json", page.screen),
    }


class _Page:
    """A page in this process; made when it is first used."""

    csrf = "token"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._client: TestClient | None = None

    def post(self, path: Path) -> object:
        """Errors: AssertionError for an answer that blames the page."""
        client = self._client = self._client or self._serve()
        answer = client.post(
            "/command",
            content=path.read_bytes(),
            headers={"content-type": "application/x-www-form-urlencoded", "accept": "application/json"},
            follow_redirects=False,
        )
        if answer.status_code >= 500:
            raise AssertionError(f"status {answer.status_code}: {answer.text[:100]}")
        return answer.status_code

    def screen(self, path: Path) -> object:
        """What the page shows of a run's state."""
        order = LaunchOptions(path.with_name("s.db"), "six-point", simulate=True)
        queue = LoadQueue(path.with_name("s.db.queue.json"))
        return Screen(load_settings(), _recipe(), RunLauncher(order), queue).state()

    def _serve(self) -> TestClient:
        self._folder.mkdir(exist_ok=True)
        person = Account("ada", Role.ENGINEER, "scrypt$2$8$1$AAAA$AAAA")
        accounts.save(self._folder / "accounts.json", {"ada": person})
        order = LaunchOptions(self._folder / "s.db", "six-point", simulate=True)
        panel = Panel(load_settings(), _recipe(), order, self._folder / "accounts.json")
        session = panel.sessions.begin(person)
        object.__setattr__(session, "csrf", self.csrf)
        client = TestClient(create_app(panel))
        client.cookies.set("station_session", session.token)
        return client


def _answers() -> dict[str, Target]:
    """What devices answer, eight bytes a frame, whatever they were asked for."""
    read = "43 18 10 01 32 00 00 00"
    segmented = "41 08 10 00 09 00 00 00, 00 61 62 63 64 65 66 67, 1b 68 69 00 00 00 00 00"
    written = "60 00 21 00 00 00 00 00, 20 00 00 00 00 00 00 00, 30 00 00 00 00 00 00 00"
    block = "c2 09 10 00 05 00 00 00, 81 61 62 63 64 65 00 00, c9 00 00 00 00 00 00 00"
    frames = bytes.fromhex(f"{read}, {segmented}, {written}, {block}".replace(",", ""))
    scanned = bytes.fromhex("44 00 00 00 00 00 00 00" + "5a 32 00 00 00 00 00 00")
    return {
        "sdo-answers": Target(frames, "answers", lambda p: list(_sdo(p.read_bytes()))),
        "lss-answers": Target(scanned, "answers", lambda p: list(_lss(p.read_bytes()))),
    }


class _AnsweringChannel(ScriptedChannel):
    """Answers each frame with the next eight bytes of the input, or with two frames where the first of them is odd."""

    def __init__(self, node: int, data: bytes, ids: tuple[int, int] | None = None) -> None:
        super().__init__(node, ids=ids)
        self._frames = iter([data[i : i + 8] for i in range(0, len(data), 8)])

    def send(self, can_id: int, data: bytes) -> None:
        """Whatever is sent."""
        for answer in self._next(2 if data[0] & 1 else 1):
            self.come(0.0, self._response_id, answer)

    def _next(self, count: int) -> Iterator[bytes]:
        yield from (frame for _, frame in zip(range(count), self._frames, strict=False))


def _each(calls: list[Callable[[], object]]) -> Iterator[object]:
    """Every call, however the ones before ended: devices go on after a refusal."""
    for call in calls:
        try:
            yield call()
        except StationError as refused:
            yield refused.sentence


def _sdo(data: bytes) -> Iterator[object]:
    channel = _AnsweringChannel(5, data)
    sdo = SdoClient(ServiceNetwork(channel, channel), 5, answer_s=0.1)
    calls: list[Callable[[], object]] = [
        lambda: sdo.upload(0x1018, 1),
        lambda: sdo.upload(0x1008, 0),
        lambda: sdo.download(0x2100, 0, b"abcdefghi"),
        lambda: sdo.download(0x2101, 1, bytes(500)),
        lambda: sdo.upload(0x1000, 0),
    ]
    return _each(calls)


def _lss(data: bytes) -> Iterator[object]:
    channel = _AnsweringChannel(5, data, ids=(LSS_REQUEST, LSS_ANSWER))
    master = CanopenLssMaster(ServiceNetwork(channel, channel))
    return _each([master.node_id, master.inquire, master.holds_any, lambda: master.configure_node(7), master.store])
