"""A new product from its own files: what is drafted, what runs, what is refused."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from cantools import database

from station.cli.app import run_command
from station.config.search_path import shipped_folder
from station.domain.product.draft import frame_roles
from station.domain.product.draft.axis_names import angle_of, axis_by_number, axis_of
from station.errors import ProductError, UsageError
from station.wiring.jobs import check_product, load_job
from station.wiring.product_files import read_layouts

SHIPPED = shipped_folder() / "dbc"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def renamed(folder: Path, kind: str) -> tuple[Path, Path]:
    """The shipped files of a product, with other names of messages, signals and objects, and no product file."""
    dbc, eds = (SHIPPED / f"{kind}{ending}" for ending in (".dbc", ".eds"))
    text = dbc.read_text("utf-8")
    for axis in "XYZ":
        text = text.replace(f" {axis} :", f" Accel_{axis.lower()}_1 :").replace(
            f" {axis} ", f" Accel_{axis.lower()}_1 "
        )
    (folder / "maker.dbc").write_text(text.replace("ACCELERATION", "Imu_1"), "utf-8")
    (folder / "maker.eds").write_text(eds.read_text("latin-1").replace("Coefficient ", "K"), "latin-1")
    return folder / "maker.dbc", folder / "maker.eds"


def test_a_new_product_passes_on_the_rehearsal_bench_by_one_command_and_no_edit(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dbc, eds = renamed(here, "accelerometer")
    assert run_command(["init", "new-one", "--dbc", str(dbc), "--eds", str(eds)]) == 0
    shown = capsys.readouterr().out
    assert shown.count("✔ PASS") == 2
    assert "readings: Imu_1 (Accel_x_1, Accel_y_1, Accel_z_1 in g): accelerometer" in shown
    job, _ = load_job("recipes/new-one-six-point.yaml")
    assert (job.product.name, job.recipe.product) == ("new-one", "new-one")
    assert job.product.map.matrix is not None
    assert (job.product.map.matrix.index, job.product.frames.counter_values) == (0x2101, 15)
    assert "# check" in (here / "dbc" / "new-one.yaml").read_text()


@pytest.mark.parametrize("kind", ["kcd", "sym"])
def test_the_frames_may_be_described_in_another_format(
    here: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    dbc, eds = renamed(here, "accelerometer")
    parsed: Any = database.load_file(dbc, sort_signals=None)
    frames = here / f"maker.{kind.upper()}"
    frames.write_text(parsed.as_kcd_string() if kind == "kcd" else parsed.as_sym_string(), "utf-8")
    assert run_command(["init", "--dbc", str(frames), "--eds", str(eds)]) == 0
    assert capsys.readouterr().out.count("✔ PASS") == 2
    assert (here / "dbc" / f"maker.{kind}").read_bytes() == frames.read_bytes()


def test_it_never_writes_over_a_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["init", "one", "--no-run"]) == 0
    before = {p: p.read_bytes() for p in here.rglob("*") if p.is_file()}
    with pytest.raises(UsageError, match=r"already .*dbc/one.yaml, .*, and init overwrites nothing"):
        run_command(["init", "one", "--no-run"])
    assert {p: p.read_bytes() for p in here.rglob("*") if p.is_file()} == before


def test_in_a_pipe_it_asks_nothing_and_answers_in_json(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["--dbc", str(SHIPPED / "gyroscope.dbc"), "--eds", str(SHIPPED / "gyroscope.eds")]
    assert run_command(["init", *names, "--no-run", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "station.init/1"
    assert document["problem"] is None
    assert sorted(Path(f).name for f in document["files"]) == [
        "config.json", "config.yaml", "gyroscope-six-point.yaml", "gyroscope.dbc", "gyroscope.eds", "gyroscope.yaml",
        "product.json", "recipe.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--eds", str(SHIPPED / "gyroscope.dbc")], "gyroscope.dbc"),
        (["--dbc", "nowhere.dbc"], "nowhere.dbc cannot be read"),
        (["--dbc", str(SHIPPED / "gyroscope.dbc"), "--sensor", "thermometer"], "no draft for sensor"),
        (["--dbc", str(SHIPPED / "gyroscope.dbc"), "--sensor", "magnetometer"], "no message whose signals x, y and z"),
        (["--dbc", str(SHIPPED / "gyroscope.dbc"), "--message", "NONE"], "NONE"),
        (["--dbc", str(SHIPPED / "gyroscope.yaml")], "gyroscope.yaml"),
    ],
)
def test_what_it_cannot_draft_is_one_sentence_and_no_file(here: Path, words: list[str], sentence: str) -> None:
    with pytest.raises((UsageError, ProductError), match=sentence) as caught:
        run_command(["init", "one", *words])
    assert caught.value.exit_code == 2
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "stem", "axis"),
    [
        ("X", "*", "x"), ("AccY", "acc*", "y"), ("accel_z", "accel_*", "z"), ("AccelerationX", "acceleration*", "x"),
        ("ax", "a*", "x"), ("YAW_RATE", "*_rate", "z"), ("LONG_ACCEL", "*_accel", "x"), ("Mag_Z_uT", "mag_*_ut", "z"),
        ("imu_gyro_y_dps", "imu_gyro_*_dps", "y"), ("VerticalAccelerationExRange", "*_acceleration_ex_range", "z"),
    ],
)  # fmt: skip
def test_an_axis_is_read_from_a_name(name: str, stem: str, axis: str) -> None:
    assert axis_of(name) == (stem, axis)


@pytest.mark.parametrize(
    ("name", "stem", "axis"),
    [
        ("PitchAngleExRange", "*_angle_ex_range", "x"), ("Roll", "*", "y"), ("Slope_lat", "slope_*", "y"),
        ("SlopeLongitudinal", "slope_*", "x"), ("TiltX", "tilt*", "x"),
    ],
)  # fmt: skip
def test_a_tilt_is_that_of_the_axis_that_moves(name: str, stem: str, axis: str) -> None:
    assert angle_of(name) == (stem, axis)


def test_three_numbered_signals_are_axes_where_their_unit_fits(here: Path) -> None:
    signal = ' SG_ BESCHL_{} : {}|16@1- ({},0) [0|0] "{}" Vector__XXX\n'
    for unit, axes in (("mg", ("BESCHL_1", "BESCHL_2", "BESCHL_3")), ("V", None)):
        lines = "".join(signal.format(i + 1, 16 * i, 0.0625, unit) for i in range(3))
        Path("one.dbc").write_text(f'VERSION ""\nNS_ :\nBS_:\nBU_: Node\nBO_ 401 Werte: 8 Node\n{lines}')
        found = [p.places() for p in frame_roles.propose_roles(read_layouts(Path("one.dbc"), {}))]
        assert found == ([] if axes is None else [axes])
    assert axis_by_number("ACC_1_RAW") == ("acc_*_raw", "x")
    assert axis_by_number("Acc2_of_3") is None


def test_axes_under_one_value_of_a_multiplexer_with_a_29_bit_identifier_are_readings(here: Path) -> None:
    names = ("LongitudinalAccel", "LateralAccel", "VerticalAccel")
    signals = [f' SG_ {n} m0 : {8 + 16 * i}|16@1- (0.002,0) [0|0] "m/s^2" Hub' for i, n in enumerate(names)]
    lines = [
        'VERSION ""',
        "NS_ :",
        "BS_:",
        "BU_: Hub",
        "BO_ 2566844930 Inertial: 8 Hub",
        ' SG_ Mux M : 0|8@1+ (1,0) [0|3] "" Hub',
    ]
    Path("hub.dbc").write_text("\n".join([*lines, *signals, ""]))
    (found,) = frame_roles.propose_roles(read_layouts(Path("hub.dbc"), {}))
    assert (found.sensor, found.places(), found.complete) == ("accelerometer", names, True)


@pytest.mark.parametrize("name", ["Speed", "ENGINE_RPM", "Counter", "Voltage", "max", "index", "LAYER"])
def test_other_names_mean_no_axis(name: str) -> None:
    assert axis_of(name) is None


def test_readings_are_found_in_a_public_dbc(reference_data: Path) -> None:
    layouts = read_layouts(reference_data / "css_canmod" / "canmod-gps.dbc", {})
    found = [(p.sensor, p.message.name, p.unit) for p in frame_roles.propose_roles(layouts) if p.complete]
    assert found == [("accelerometer", "gnss_imu", "m/s^2"), ("gyroscope", "gnss_imu", "deg/s")]


def test_of_all_cars_one_sends_a_sensor_of_three_axes(reference_data: Path) -> None:
    files = sorted((reference_data / "dbc_public").rglob("*.dbc"))
    assert len(files) > 60
    proposed = [(f.name, p) for f in files for p in frame_roles.propose_roles(read_layouts(f, {})) if p.complete]
    assert [(file, p.message.name, p.sensor) for file, p in proposed] == [
        ("ford_fusion_2018_pt.dbc", "Accel_Data", "accelerometer")
    ]


SENDER = """VERSION ""
NS_ :
BS_:
BU_: Rover
BO_ 11 GyroXy: 8 Rover
 SG_ GyroX : 0|32@1- (0.0001,0) [0|0] "rad/s" Vector__XXX
 SG_ GyroY : 32|32@1- (0.0001,0) [0|0] "rad/s" Vector__XXX

BO_ 12 Z: 8 Rover
 SG_ GyroZ : 0|32@1- (0.0001,0) [0|0] "rad/s" Vector__XXX
 SG_ Temperature : 32|8@1- (0.5,24) [-40|87.5] "°C" Vector__XXX

SIG_VALTYPE_ 99 Gone : 1;
"""


def test_a_device_that_only_sends_passes_with_its_axes_in_two_messages_and_its_temperature_among_them(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "rover.dbc").write_text(SENDER, "cp1252")
    assert run_command(["init", "--dbc", "rover.dbc", "--folder", "draft"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("✔ PASS") == 2
    assert "GyroXy (GyroX, GyroY, Z.GyroZ in rad/s): gyroscope" in shown
    product, config = ((here / "draft" / f).read_text("utf-8") for f in ("dbc/rover.yaml", "config.yaml"))
    assert "protocol: none" in product
    # Identifiers 11 and 12 of the first nest's device are 13 and 14 of the second's.
    assert "node: 0x13" in config


def test_a_long_file_name_gives_a_name_that_fits_and_one_that_is_given_is_refused(here: Path) -> None:
    name = f"rover-of-{'very-' * 12}many-words"
    (here / f"{name}.dbc").write_text(SENDER, "cp1252")
    assert run_command(["init", "--dbc", f"{name}.dbc", "--no-run"]) == 0
    (product,) = (here / "dbc").glob("*.yaml")
    assert name.startswith(product.stem)
    with pytest.raises(UsageError, match=f"has {len(name)} characters; a product's may have 41"):
        run_command(["init", name, "--dbc", f"{name}.dbc"])


TILTS = """VERSION ""
NS_ :
BS_:
BU_: Unit
BO_ 2364549630 SSI2: 8 Unit
 SG_ PitchAngleExRange : 0|24@1+ (3.0517578125E-005,-250) [-250|250.99] "deg" Vector__XXX
 SG_ RollAngleExRange : 24|24@1+ (3.0517578125E-005,-250) [-250|250.99] "deg" Vector__XXX
 SG_ SteeringAngle : 48|16@1+ (0.1,0) [0|0] "deg" Vector__XXX
"""


def test_an_inclinometer_of_two_tilts_passes_and_of_one_is_drafted_where_it_is_named(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "slope.dbc").write_text(TILTS, "utf-8")
    assert run_command(["init", "--dbc", "slope.dbc"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("✔ PASS") == 2
    assert "SSI2 (PitchAngleExRange, RollAngleExRange in deg): inclinometer" in shown
    single = TILTS.replace(" SG_ RollAngleExRange", " SG_ Temperature").replace(
        '"deg" Vector__XXX\n SG_ S', '"" V\n SG_ S'
    )
    (here / "one.dbc").write_text(single, "utf-8")
    with pytest.raises(ProductError, match="no message whose signals"):
        run_command(["init", "--dbc", "one.dbc", "--folder", "a", "--no-run"])
    assert run_command(["init", "--dbc", "one.dbc", "--folder", "b", "--sensor", "inclinometer", "--no-run"]) == 0
    assert "axes: 1" in (here / "b" / "recipes" / "one-n-point.yaml").read_text("utf-8")


def test_an_eds_alone_drafts_the_dbc_that_angles_need_no_more_than(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    eds = str(SHIPPED / "examples" / "siko-ik360.eds")
    assert run_command(["init", "slope", "--eds", eds]) == 0
    assert f"station init slope --dbc slope.dbc --eds {eds}" in capsys.readouterr().out
    assert run_command(["init", "slope", "--dbc", "slope.dbc", "--eds", eds]) == 0
    shown = capsys.readouterr().out
    assert shown.count("✔ PASS") == 2
    assert "TPDO1 (Slope_longitudinal, Slope_lateral in deg): inclinometer" in shown


def test_counts_of_an_eds_are_told_to_need_a_factor(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    eds = SHIPPED / "examples" / "epson-m-a552.eds"
    assert run_command(["init", "shaker", "--eds", str(eds), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == ["shaker.dbc"]
    drafted, shipped = read_layouts(here / "shaker.dbc", None), read_layouts(eds.with_suffix(".dbc"), None)
    places = [
        {m.can_id: [(s.start, s.length, s.signed, s.is_float) for s in m.signals] for m in found.values()}
        for found in (drafted, shipped)
    ]
    assert places[0] == places[1]
    with pytest.raises(ProductError, match="in counts, without factor and unit"):
        run_command(["init", "shaker", "--dbc", "shaker.dbc", "--eds", str(eds)])
    with pytest.raises(ProductError, match="maps no object to a TPDO"):
        (here / "none.eds").write_text(eds.read_text("latin-1").replace("[1A0", "[5A0"), "latin-1")
        run_command(["init", "none", "--eds", "none.eds"])


def test_a_pdo_without_an_identifier_is_left_out_of_the_drafted_dbc(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its message would have the identifier of NMT."""
    text = (SHIPPED / "accelerometer.eds").read_text("latin-1")
    first, second = "$NODEID+0x180", "$NODEID+0x280"
    assert first in text and second in text
    (here / "half.eds").write_text(text.replace(second, "0x80000000"), "latin-1")
    assert run_command(["init", "half", "--eds", "half.eds"]) == 0
    assert "left out: TPDO 2, to which half.eds gives no identifier" in capsys.readouterr().out
    assert [m.can_id for m in read_layouts(here / "half.dbc", None).values()] == [0x181]
    (here / "none.eds").write_text(text.replace(second, "0").replace(first, "0xC0000000"), "latin-1")
    with pytest.raises(ProductError, match=r"maps no object to a TPDO .* with an identifier"):
        run_command(["init", "none", "--eds", "none.eds"])


UDS = """map:
  protocol: uds
  uds: {request: 0x741, response: 0x761, session: 3}
  matrix: {index: 0x3010, type: Q2.14}
  offset: {index: 0x3020, type: INT16, scale: 0.01}
  output: {index: 0x3060}
  save: {index: 0x3F00, sub: 0}
  serial: {index: 0xF18C, sub: 0, kind: text, printed: '(.*)'}
"""
TEMPLATE = """map:
  protocol: template
  template:
    request: 0x18EF11F9
    response: 0x18EFF911
    read: {send: "A1 index sub", answer: "A2 index sub value:4"}
    write: {send: "B1 index sub value:4", answer: "B2 index sub value:4"}
    save: {send: "C1", answer: "C2"}
    reset: {send: "D1", answer: "D2"}
  matrix: {index: 0x2101}
  offset: {index: 0x2102}
  output: {index: 0x2106, type: UINT32}
  serial: label
"""


@pytest.mark.parametrize("access", [UDS, TEMPLATE])
def test_a_device_of_another_protocol_is_rehearsed_without_an_eds(
    here: Path, access: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "rover.dbc").write_text(SENDER, "cp1252")
    assert run_command(["init", "--dbc", "rover.dbc", "--no-run"]) == 0
    product, recipe = here / "dbc" / "rover.yaml", here / "recipes" / "rover-six-point.yaml"
    product.write_text(product.read_text("utf-8").partition("map:")[0] + access, "utf-8")
    with_verification = recipe.read_text("utf-8").replace("# verify:", "verify:")
    recipe.write_text(re.sub(r"^# (  .*)$", r"\1", with_verification, flags=re.MULTILINE), "utf-8")
    capsys.readouterr()
    assert run_command(["run", "--units", "1", "--json"]) == 0
    (unit,) = json.loads(capsys.readouterr().out)["units"]
    assert (unit["outcome"], unit["written"], unit["verified"]) == ("PASS", True, True)


def test_coarse_readings_between_two_codes_are_not_taken_for_clipped_ones(
    here: Path, reference_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dbc = reference_data / "css_canmod" / "canmod-gps.dbc"
    assert run_command(["init", "--dbc", str(dbc)]) == 0
    assert capsys.readouterr().out.count("✔ PASS") == 2


def test_counts_without_a_factor_are_no_readings(here: Path) -> None:
    (here / "raw.dbc").write_text(SENDER.replace("(0.0001,0)", "(1,0)").replace("rad/s", ""), "cp1252")
    with pytest.raises(ProductError, match=r"GyroXy gives GyroX, GyroY, Z.GyroZ in counts, .* and \"deg/s\""):
        run_command(["init", "--dbc", "raw.dbc"])
    assert [p.name for p in here.iterdir()] == ["raw.dbc"]


def test_a_device_that_only_sends_cannot_keep_a_calibration(here: Path) -> None:
    (here / "rover.dbc").write_text(SENDER, "cp1252")
    assert run_command(["init", "--dbc", "rover.dbc", "--no-run"]) == 0
    product = here / "dbc" / "rover.yaml"
    product.write_text(product.read_text("utf-8").replace("serial: label", "serial: {index: 0x1018, sub: 4}"), "utf-8")
    with pytest.raises(ProductError, match="protocol: none means that the device only sends"):
        load_job("recipes/rover-six-point.yaml")


@pytest.mark.parametrize(
    "name",
    ["siko-ik360", "ifm-cr2101", "balluff-bsi-r65k0", "balluff-bsi-r65k0-rate", "sick-tmm88d", "dis-qg65"],
)
def test_a_published_device_is_drafted_as_its_product_was_written_by_hand(name: str, here: Path) -> None:
    files = SHIPPED / "examples" / name
    run_command(["init", "--no-run", "--dbc", f"{files}.dbc", "--eds", f"{files}.eds"])
    drafted, written = (
        check_product(str(p))[0].map for p in (here / "dbc" / f"{name}.yaml", files.with_suffix(".yaml"))
    )
    assert drafted.preset == written.preset
    assert [n.address for _, n in drafted.coefficients()] == [n.address for _, n in written.coefficients()]
    assert drafted.pdo == written.pdo
    assert {s.name for s in drafted.settings} == {s.name for s in written.settings if s.calibrating != 1}
    recipe = next((here / "recipes").glob("*.yaml"))
    assert (load_job(recipe)[0].recipe.method == "one-point") == (written.offset is not None)


def test_angles_of_the_recipe_stay_within_the_range_of_an_inclinometer(here: Path) -> None:
    files = SHIPPED / "examples" / "ifm-cr2101"
    eds = here / "no-zero.eds"
    eds.write_text(files.with_suffix(".eds").read_text("latin-1").replace("zero point", "mean"), "latin-1")
    run_command(["init", "--no-run", "--dbc", f"{files}.dbc", "--eds", str(eds), "tilt"])
    recipe = load_job("recipes/tilt-n-point.yaml")[0].recipe
    assert [p.name for p in recipe.positions[:5]] == ["level", "x+13", "x-13", "x+27", "x-27"]


def test_a_dbc_that_is_wrong_where_the_readings_are_is_refused_before_anything_is_written(here: Path) -> None:
    text = (SHIPPED / "accelerometer.dbc").read_text("utf-8")
    line = next(line for line in text.splitlines() if line.startswith(" SG_ X "))
    (here / "twice.dbc").write_text(text.replace(line, f"{line}\n{line}"), "utf-8")
    with pytest.raises(ProductError, match=r"^twice\.dbc, line \d+: The signals X and X are overlapping"):
        run_command(["init", "one", "--no-run", "--dbc", "twice.dbc"])
    assert [p.name for p in here.iterdir()] == ["twice.dbc"]


@pytest.mark.parametrize("name", ["1e400", "null", "0x11"])
def test_a_name_that_yaml_takes_for_a_number_stays_a_name(name: str, here: Path) -> None:
    assert run_command(["init", name, "--no-run"]) == 0
    assert load_job(f"recipes/{name}-six-point.yaml")[0].product.name == name


def test_a_device_that_cannot_be_told_to_save_is_not_told(here: Path) -> None:
    text = (SHIPPED / "accelerometer.eds").read_text("latin-1").replace("[1010", "[2F10").replace("0x1010", "0x2F10")
    (here / "maker.eds").write_text(text, "latin-1")
    run_command(["init", "one", "--no-run", "--dbc", str(SHIPPED / "accelerometer.dbc"), "--eds", "maker.eds"])
    assert load_job("recipes/one-six-point.yaml")[0].product.map.save is None


@pytest.mark.parametrize("access", ["ro", "const", "*nobody"])
@pytest.mark.parametrize(("index", "key"), [("1010", "save"), ("1011", "restore"), ("1020", "configuration")])
def test_a_command_that_nobody_may_write_is_not_given(access: str, index: str, key: str, here: Path) -> None:
    text = (SHIPPED / "accelerometer.eds").read_text("latin-1")
    text, count = re.subn(rf"(\[{index}sub1\][^\[]*AccessType=)\w+", rf"\g<1>{access}", text)
    assert count == 1
    (here / "maker.eds").write_text(text, "latin-1")
    words = ["init", "one", "--no-run", "--dbc", str(SHIPPED / "accelerometer.dbc"), "--eds", "maker.eds"]
    assert run_command(words) == 0
    assert getattr(load_job("recipes/one-six-point.yaml")[0].product.map, key) is None


def test_files_that_contradict_each_other_are_refused_before_anything_is_written(here: Path) -> None:
    dbc, eds = renamed(here, "accelerometer")
    text = eds.read_text("latin-1")
    eds.write_text(re.sub(r"(\[1A00sub5\][^\[]*DefaultValue=0x\w{6})10", r"\g<1>08", text), "latin-1")
    before = set(here.rglob("*"))
    with pytest.raises(ProductError, match=r"maker\.dbc contradicts the PDO mapping of .*maker\.eds: .*; nothing was"):
        run_command(["init", "new-one", "--dbc", str(dbc), "--eds", str(eds)])
    assert set(here.rglob("*")) == before
