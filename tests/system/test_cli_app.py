"""The command line as a process: help, errors as one sentence, exit codes, a pipe that closes."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from station.cli import app
from station.cli.app import commands, main
from tests.fakes.command import captured

STATION = [sys.executable, "-m", "station"]


def station(*args: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*STATION, *args], capture_output=True, text=True, timeout=60, cwd=cwd, check=False)


def loaded(*args: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "station", *args], capture_output=True, text=True, check=True
    )
    return {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}


def test_help_lists_every_command_and_loads_nothing_heavy() -> None:
    done = station("--help")
    assert done.returncode == 0
    assert all(f"  {name} " in done.stdout for name in commands())
    assert max(map(len, done.stdout.splitlines())) <= 80
    heavy = {"numpy", "pydantic", "typer", "rich", "can", "canopen", "yaml", "sqlite3", "scipy"}
    assert not loaded("--help") & heavy


def test_a_run_loads_no_table_library() -> None:
    program = "import sys, station.cli._run; print({'pandas', 'pyarrow', 'asammdf'} & set(sys.modules) or 'none')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "none\n", done.stderr


def test_every_command_has_help_with_an_example_to_paste(capfd: pytest.CaptureFixture[str]) -> None:
    for name, line in commands().items():
        with pytest.raises(SystemExit) as ended:
            main([name, "--help"])
        output = capfd.readouterr().out
        assert ended.value.code == 0, name
        assert line, name
        assert line.rstrip(".") in " ".join(output.split()), name
        assert f"station {name}" in output.split("Options:")[0].split("\n", 1)[1], f"{name} shows no example"


def test_no_command_shows_the_list_and_is_a_usage_error() -> None:
    done = captured()
    assert (done.returncode, done.stdout) == (2, "")
    assert "Usage: station COMMAND" in done.stderr


def test_version() -> None:
    assert station("--version").stdout.startswith("station 0.")


def test_an_unknown_command_or_option_is_one_sentence() -> None:
    for args in (["rum"], ["run", "--no-such-option"], ["run", "--units", "many"], ["ru\x1b[31mn\nx"]):
        done = captured(*args)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1
        assert "\x1b" not in done.stderr


#: Words of the parser and of its validator, which are not ours.
THEIRS = re.compile(
    r"Input should|Invalid value|No such option|requires an|Got unexpected|Missing (?:arg|opt|param)|Error"
)


def test_whatever_is_wrong_with_a_command_line_is_said_in_our_words() -> None:
    tried = 0
    for name in commands():
        lines = [[name, "--no-such-option"], [name, *["word"] * 9]]
        for param in app._command(name).params:
            option = param.opts[0]
            if not option.startswith("-"):
                continue
            lines.append([name, f"{option}=x"] if param.is_flag else [name, option])
            if param.type_descriptor.annotation in (int, float):
                lines.append([name, option, "many"])
            if param.min is not None:
                lines.append([name, option, str(param.min - 1)])
        for line in lines:
            done = captured(*line)
            assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), line
            assert not THEIRS.search(done.stderr), done
            tried += 1
    assert tried > 300


def test_a_near_miss_is_named() -> None:
    assert "did you mean `run`?" in captured("runn").stderr


def test_a_bug_is_a_sentence_a_file_and_exit_70(tmp_path: Path) -> None:
    program = (
        "import station.cli.app as app\n"
        "def broken(args):\n    raise ZeroDivisionError('x')\n"
        "app.run_command = broken\napp.main(['run'])\n"
    )
    env = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=env, check=False)
    assert done.returncode == 70
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1
    (crash,) = tmp_path.glob("station-crash-*.txt")
    assert str(crash) in done.stderr
    assert "ZeroDivisionError" in crash.read_text()


def test_ctrl_c_is_exit_4() -> None:
    program = (
        "import station.cli.app as app\n"
        "def stop(args):\n    raise KeyboardInterrupt\n"
        "app.run_command = stop\napp.main([])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (4, "station: Stopped by the operator.\n")


def test_a_reader_that_goes_away_leaves_no_traceback() -> None:
    with subprocess.Popen([*STATION, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert "Traceback" not in process.stderr.read()


@pytest.mark.parametrize("command", [["effects", "--json"], ["check", "six-point"]])
def test_a_full_disk_under_the_output_is_one_sentence(command: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "station", *command], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (3, "station: The output cannot be written: the disk is full.\n")


def test_a_closed_output_is_no_bug() -> None:
    script = f"exec {sys.executable} -m station effects >&-"
    done = subprocess.run(["/bin/sh", "-c", script], stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("command", [["run", "--simulate"], ["recover", "SN1", "--simulate"], ["audit"], ["report"]])
def test_a_folder_is_no_log(command: list[str]) -> None:
    done = captured(*command, "--db", "/")
    assert done.returncode in (2, 3)
    assert re.match(r"station: The log / cannot be (opened|read): it is a folder;", done.stderr)
    assert done.stderr.count("\n") == 1


def test_a_sentence_on_a_terminal_is_broken_between_words_and_whole_in_a_pipe(tmp_path: Path) -> None:
    words = [*STATION, "--no-progress", "calibrate", "--samples", "nowhere.csv", "--recipe", "six-point"]
    piped = subprocess.run(words, capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False).stderr
    terminal, end = os.openpty()
    with os.fdopen(terminal, "rb", buffering=0) as screen:
        subprocess.run(
            words, stdout=subprocess.DEVNULL, stderr=end, timeout=60, cwd=tmp_path, check=False,
            env={**os.environ, "COLUMNS": "50"},
        )  # fmt: skip
        os.close(end)
        shown = screen.read(4000).decode().splitlines()
    assert piped.count("\n") == 1
    assert len(shown) > 1
    assert max(map(len, shown)) <= 50
    assert " ".join(line.strip() for line in shown) == piped.strip()


def test_letters_that_the_output_does_not_take_stop_nothing_and_json_keeps_them(tmp_path: Path) -> None:
    def run(*words: str) -> str:
        environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
        done = subprocess.run(
            [*STATION, *words], capture_output=True, timeout=60, cwd=tmp_path, env=environment, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.decode("ascii")

    assert "? PASS" in run("run", "--simulate", "--units", "1", "--recipe", "one-point", "--operator", "Zo\u00eb")
    assert json.loads(run("audit", "SN0001", "--json"))["attempts"][0]["operator"] == "Zo\u00eb"


@pytest.mark.parametrize("columns", ["1", "40"])
@pytest.mark.parametrize("words", [("--help",), ("check", "six-point"), ("effects",)])
def test_a_narrow_screen_breaks_lines_and_no_command(
    columns: str, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    done = captured(*words)
    assert (done.returncode, done.stderr) == (0, "")
