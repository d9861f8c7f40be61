"""The work of `station init`: ask, read, propose, write what is not there yet, check, run."""

import io
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from station.cli import _output
from station.config.search_path import shipped_folder
from station.domain.can.signals import FrameLayout
from station.domain.product.draft import frame_roles, map_objects
from station.domain.product.draft.axis_objects import axis_offsets, readings_pdo
from station.domain.product.draft.dbc_text import dbc_text, without_identifier
from station.domain.product.draft.frame_roles import FrameRoles
from station.domain.product.draft.map_objects import MapObjects
from station.domain.product.draft.product_text import ProductDraft, product_text, scalar
from station.domain.product.draft.recipe_text import recipe_text
from station.errors import InputError, ProductError, UsageError
from station.messages import Message, render, system_reason
from station.wiring.jobs import load_job
from station.wiring.product_files import OTHER_FORMATS, object_titles, read_dictionary, read_layouts

SCHEMA = "station.init/1"
#: The product that a draft from nothing is a copy of, and the shipped recipe of each kind of sensor.
EXAMPLE = "accelerometer"
RECIPES: Mapping[str, str] = {
    "accelerometer": "six-point", "magnetometer": "magnetometer-six-point", "gyroscope": "gyroscope-six-point",
    "inclinometer": "inclinometer-n-point",
}  # fmt: skip
#: The same for a device that keeps offsets and no gains.
OFFSET_RECIPES: Mapping[str, str] = {
    "accelerometer": "one-point", "magnetometer": "magnetometer-one-point", "gyroscope": "gyroscope-one-point",
    "inclinometer": "inclinometer-zero",
}  # fmt: skip
#: Characters of a product's name that leave its recipes' names within what a recipe's may have.
LONGEST_NAME = 64 - max(len(f"-{recipe}") for recipe in (*RECIPES.values(), *OFFSET_RECIPES.values()))
#: Node of the first nest, and the last that there may be (CiA 301).
FIRST_NODE, LAST_NODE = 0x11, 127
#: So many proposals are shown to choose from.
MOST_PROPOSALS = 9

CONFIG = """\
# yaml-language-server: $schema=schemas/config.json
# A rehearsal bench: bus, rig and devices are simulated. On a real bench name the interface and what turns the fixture.
schema: station.config/1
station: rehearsal
bus: {interface: simulated}                # on a bench: {interface: socketcan, channel: can0, bitrate: 500000}
nests:                                     # one a seat of the fixture; the device in it answers at this node id
  - {name: A, node: 0x11}
  - {name: B, node: SECOND}
recipe: RECIPE
database: station.db
"""


@dataclass(frozen=True, slots=True)
class InitRequest:
    """See the command's options."""

    name: str | None
    dbc: Path | None
    eds: Path | None
    sensor: str | None
    message: str | None
    folder: Path
    runs: bool


@dataclass(frozen=True, slots=True)
class DraftFiles:
    """The texts to write, by file; those of a device are copies. recipe: its name."""

    recipe: str
    texts: Mapping[Path, bytes]
    remarks: Sequence[Message]


def draft_product(request: InitRequest, *, as_json: bool) -> int:
    """Writes the draft, checks it, runs it; the exit code of the run. Errors: UsageError, ProductError."""
    request = _completed(request)
    if request.dbc is None and request.eds is not None:
        return _draft_dbc(request, request.eds, as_json=as_json)
    draft = _from_nothing(request) if request.dbc is None else _from_files(request)
    if request.eds is not None:
        _refuse_contradiction(request.eds, request.dbc, draft)
    _write(request.folder, draft.texts)
    if not as_json:
        for message in (*draft.remarks, *(Message("init-wrote", file=str(request.folder / p)) for p in draft.texts)):
            _output.print_message(message)
    recipe = str(Path("recipes") / f"{draft.recipe}.yaml")
    with chdir(request.folder):
        problem = _problem(recipe)
        code = problem.exit_code if problem is not None else _run(recipe, as_json=as_json) if request.runs else 0
    if as_json:
        sentence = None if problem is None else problem.sentence
        files = [str(request.folder / path) for path in draft.texts]
        remarks = [render(m) for m in draft.remarks]
        _output.print_json(
            {"schema": SCHEMA, "files": files, "remarks": remarks, "problem": sentence, "exit_code": code}
        )
        return code
    if problem is not None:
        raise problem
    _output.print_message(Message("init-next", recipe=recipe, product=next(str(p) for p in draft.texts)))
    return code


def _draft_dbc(request: InitRequest, eds: Path, *, as_json: bool) -> int:
    """The DBC alone, by the PDO mapping: the EDS does not tell what a count is. Errors: ProductError, UsageError."""
    dictionary = read_dictionary(eds, 1, frozenset())
    text = dbc_text(dictionary, object_titles(eds))
    if not text:
        raise ProductError("init-no-mapping", eds=str(eds))
    dbc = Path(f"{request.name}.dbc")
    _write(request.folder, {dbc: text.encode()})
    path = str(request.folder / dbc)
    remarks = [Message("init-dbc-drafted", name=request.name, dbc=path, eds=str(eds))]
    if nameless := without_identifier(dictionary):
        remarks.insert(0, Message("init-pdos-left-out", numbers=nameless, eds=str(eds)))
    if as_json:
        said = [render(remark) for remark in remarks]
        _output.print_json({"schema": SCHEMA, "files": [path], "remarks": said, "problem": None, "exit_code": 0})
    else:
        for remark in remarks:
            _output.print_message(remark)
    return 0


def _completed(request: InitRequest) -> InitRequest:
    """The request with what a person on a terminal adds to it. Errors: UsageError."""
    if request.dbc is None and sys.stdin.isatty():
        request = replace(request, dbc=_ask_file("init-ask-dbc"))
        if request.dbc is not None and request.eds is None:
            request = replace(request, eds=_ask_file("init-ask-eds"))
    if request.sensor is not None and request.sensor not in RECIPES:
        raise UsageError("init-unknown-sensor", sensor=request.sensor[:40], known=tuple(RECIPES))
    source = request.dbc or request.eds
    if request.name is not None and len(request.name) > LONGEST_NAME:
        raise UsageError("init-name-too-long", name=request.name[:40], count=len(request.name), limit=LONGEST_NAME)
    name = request.name or ("my-sensor" if source is None else source.stem)
    return replace(request, name=re.sub(r"[^\w\-]+", "-", name)[:LONGEST_NAME].strip("-").lower() or "product")


def _ask_file(question: str) -> Path | None:
    print(render(Message(question)), end=" ", file=sys.stderr, flush=True)
    text = sys.stdin.readline(4096).strip()
    return Path(text).expanduser() if text else None


def _from_nothing(request: InitRequest) -> DraftFiles:
    """The simulated accelerometer under another name."""
    assert request.name is not None
    shipped, name = shipped_folder(), request.name
    recipe = f"{name}-six-point"
    product = (shipped / "dbc" / f"{EXAMPLE}.yaml").read_text(encoding="utf-8")
    product = re.sub(rf"^(eds|  dbc): {EXAMPLE}", rf"\1: {name}", product, flags=re.MULTILINE)
    product = re.sub(rf"^name: {EXAMPLE}", f"name: {scalar(name)}", product, flags=re.MULTILINE)
    text = (shipped / "recipes" / "six-point.yaml").read_text(encoding="utf-8")
    text = re.sub(r"^name: \S+", f"name: {scalar(recipe)}", text, flags=re.MULTILINE)
    text = re.sub(rf"^product: {EXAMPLE} *#.*$", f"product: {scalar(name)}", text, flags=re.MULTILINE)
    texts = {
        Path("dbc") / f"{name}.yaml": product.encode(),
        Path("dbc") / f"{name}.dbc": (shipped / "dbc" / f"{EXAMPLE}.dbc").read_bytes(),
        Path("dbc") / f"{name}.eds": (shipped / "dbc" / f"{EXAMPLE}.eds").read_bytes(),
        Path("recipes") / f"{recipe}.yaml": text.encode(),
    }
    return DraftFiles(recipe, _with_config(request, recipe, texts), ())


def _from_files(request: InitRequest) -> DraftFiles:
    assert request.dbc is not None
    assert request.name is not None
    layouts = read_layouts(request.dbc, {})
    roles, remarks = _chosen(request, layouts)
    if roles.in_counts:
        names = ", ".join(place for place in roles.places() if place)
        unit = frame_roles.unit_of_sensor(roles.sensor)
        raise ProductError("init-counts", dbc=str(request.dbc), message=roles.message.name, signals=names, unit=unit)
    eds, objects, pdo, offsets = None, MapObjects(None, None), None, None
    if request.eds is not None:
        eds, titles = read_dictionary(request.eds, roles.node, frozenset()), object_titles(request.eds)
        objects, pdo = map_objects.find(eds, titles), readings_pdo(roles, eds, titles)
        offsets = None if pdo is None or objects.offset else axis_offsets(pdo.readings, eds, titles)
    source = request.dbc.name if request.eds is None else f"{request.dbc.name} and {request.eds.name}"
    temperature = frame_roles.temperature_of(layouts, roles)
    read_layouts(request.dbc, frame_roles.proposed_signals(roles, temperature))  # a mistake is one of the given file
    node = FIRST_NODE if eds is None else roles.node  # without a node id the first nest has the DBC's own identifiers
    suffix = request.dbc.suffix.lower() if request.dbc.suffix.lower() in OTHER_FORMATS else ".dbc"
    draft = ProductDraft(request.name, roles, node, temperature, eds, objects, source, pdo, offsets, suffix)
    shipped = (OFFSET_RECIPES if draft.offsets_only else RECIPES)[roles.sensor]
    recipe = f"{request.name}-{shipped.removeprefix(f'{roles.sensor}-')}"
    template = (shipped_folder() / "recipes" / f"{shipped}.yaml").read_text(encoding="utf-8")
    unit = frame_roles.unit_of_sensor(roles.sensor)
    texts = {
        Path("dbc") / f"{request.name}.yaml": product_text(draft).encode(),
        Path("dbc") / f"{request.name}{suffix}": request.dbc.read_bytes(),
        Path("recipes") / f"{recipe}.yaml": recipe_text(draft, template, recipe, unit).encode(),
    }
    if request.eds is not None:
        texts[Path("dbc") / f"{request.name}.eds"] = request.eds.read_bytes()
    if not draft.stores:
        remarks = [*remarks, Message("init-no-calibration", source=source)]
    frames = [*(roles.frames or (roles.message,)), *([] if temperature is None else [temperature[0]])]
    return DraftFiles(recipe, _with_config(request, recipe, texts, {f.can_id for f in frames}), remarks)


def second_node(can_ids: Collection[int]) -> int:
    """The node of the second nest: its identifiers, those of the DBC and a step, must be none of the first one's."""
    steps = range(1, LAST_NODE - FIRST_NODE + 1)
    return FIRST_NODE + next((n for n in steps if not {i + n for i in can_ids} & set(can_ids)), 1)


def _with_config(
    request: InitRequest, recipe: str, texts: dict[Path, bytes], can_ids: Collection[int] = ()
) -> Mapping[Path, bytes]:
    """A rehearsal bench where there is no bench yet, and the schemas that the files name for editors. can_ids: of the
    product's messages."""
    for kind in ("recipe", "product", "config"):
        place = Path("schemas") / f"{kind}.json"
        if not (request.folder / place).exists():
            texts[place] = (shipped_folder() / place).read_bytes()
    if not (request.folder / "config.yaml").exists():
        config = CONFIG.replace("RECIPE", recipe).replace("SECOND", f"0x{second_node(can_ids):02X}")
        texts[Path("config.yaml")] = config.encode()
    return texts


def _chosen(request: InitRequest, layouts: Mapping[str, FrameLayout]) -> tuple[FrameRoles, list[Message]]:
    """The message of the readings: the one named, the one a person chooses, or the likeliest. Errors: ProductError."""
    if request.message is not None and request.message not in layouts:
        raise ProductError(
            "init-message-unknown", dbc=str(request.dbc), message=request.message, known=tuple(layouts)[:20]
        )
    wanted = layouts if request.message is None else {request.message: layouts[request.message]}
    found = [p for p in frame_roles.propose_roles(wanted, request.sensor) if p.complete][:MOST_PROPOSALS]
    if not found:
        raise ProductError("init-no-readings", dbc=str(request.dbc), messages=tuple(wanted)[:8])
    number = 0
    if len(found) > 1 and sys.stdin.isatty():
        for i, each in enumerate(found, 1):
            print(f"  {i}  {_named(each)}", file=sys.stderr)
        print(render(Message("init-ask-message", count=len(found))), end=" ", file=sys.stderr, flush=True)
        text = sys.stdin.readline(20).strip()
        number = int(text) - 1 if text.isdigit() and 0 < int(text) <= len(found) else 0
    chosen = found[number]
    remarks = [Message("init-readings", readings=_named(chosen))]
    others = [p.message.name for p in found if p.message.name != chosen.message.name]
    if others and not sys.stdin.isatty():
        remarks.append(Message("init-other-readings", messages=tuple(dict.fromkeys(others))))
    return chosen, remarks


def _named(roles: FrameRoles) -> str:
    names = ", ".join(place for place in roles.places() if place)
    return f"{roles.message.name} ({names}{f' in {roles.unit}' if roles.unit else ''}): {roles.sensor}"


def _write(folder: Path, texts: Mapping[Path, bytes]) -> None:
    """All files, or none where one of them is there already. Errors: UsageError."""
    there = [str(folder / path) for path in texts if (folder / path).exists()]
    if there:
        raise UsageError("init-file-exists", files=tuple(there))
    try:
        for path, content in texts.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            with (folder / path).open("xb") as file:
                file.write(content)
    except OSError as exc:
        raise UsageError("file-not-written", file=str(folder), why=system_reason(exc)) from exc


def _refuse_contradiction(eds: Path, dbc: Path | None, draft: DraftFiles) -> None:
    """Files of the device that contradict each other are corrected first: nothing is drafted. Errors: ProductError."""
    with TemporaryDirectory() as name:
        _write(Path(name), draft.texts)
        with chdir(name):
            problem = _problem(str(Path("recipes") / f"{draft.recipe}.yaml"))
    if problem is not None and problem.message.id == "frames-contradict-eds":
        mismatches = problem.message.parameters["mismatches"]
        raise ProductError("init-files-contradict", dbc=str(dbc), eds=str(eds), mismatches=mismatches)


def _problem(recipe: str) -> InputError | None:
    """What the check of the draft says against it."""
    try:
        load_job(recipe)
    except InputError as exc:
        return exc
    return None


def _run(recipe: str, *, as_json: bool) -> int:
    """Two units on the rehearsal bench, into a log of its own where the bench is a real one."""
    from station.cli.app import run_command
    from station.wiring.rehearsal import rehearsing

    words = ["run", "--recipe", recipe, "--units", "2"]
    if not rehearsing(None):
        words += ["--simulate", "--db", "rehearsal.db"]
    go: Callable[[], int] = lambda: run_command(words)  # noqa: E731
    if not as_json:
        return go()
    with redirect_stdout(io.StringIO()):
        return go()
