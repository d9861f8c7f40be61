"""Every option of every command either has an effect or is refused: none is taken in silence."""

import re
from pathlib import Path

import pytest

from station.cli.app import _command, _module, commands
from tests.fakes import fixture_run
from tests.fakes.command import captured

#: How a help says with what an option goes: "With --verify: …", "type1, bias: …", "--simulate: …".
_WITH = re.compile(r"(?:With )?((?:--[a-z-]+|[a-z0-9]+)(?:(?:, | or | and )(?:--[a-z-]+|[a-z0-9]+))*): ")
#: Where the partner is not on the line, but settled by config.yaml or by the file: the command itself refuses it.
CONDITIONAL = {("run", "--mounted"), ("simulate", "--product")}
#: What a command cannot do without.
NEEDED = {
    "backtest": ("--recipe", "six-point"),
    "calibrate": ("--samples", "a.csv", "--recipe", "six-point"),
    "certificate": ("SN1",),
    "diagnose": ("--samples", "a.csv", "--recipe", "six-point"),
    "flash": ("f.yaml", "--serial", "SN1"),
    "golden": ("list",),
    "plant": ("serve",),
    "recover": ("SN1",),
    "replay": ("a.log",),
}
#: Commands of several actions: the first that does not have the option is tried.
ACTIONS = {"key": ("rotate", "revoke"), "msa": ("grr", "type1", "linearity"), "rig": ("check", "axes")}


def declared() -> list[tuple[str, str, tuple[str, ...]]]:
    """Command, option, and the words one of which it goes with, by the tables and by the help."""
    found = []
    for name in commands():
        table = dict(getattr(_module(name), "GOES_WITH", {}))
        for parameter in _command(name).params:
            option = max(parameter.opts, key=len)
            says = _WITH.match(getattr(parameter, "help", None) or "")
            partners = re.split(r", | or | and ", says[1]) if says else []
            if option.startswith("--") and (option in table or partners):
                found.append((name, option, tuple(table.get(option, partners))))
    return found


def words_for(name: str, option: str, partners: tuple[str, ...]) -> list[str]:
    """A line of the command with this option and none of its partners."""
    action = next((one for one in ACTIONS.get(name, ()) if one not in partners), None)
    base = NEEDED.get(name, ()) if action is None else (action,)
    (parameter,) = (p for p in _command(name).params if option in p.opts)
    kind = repr(parameter.type_descriptor.annotation)
    value = [] if parameter.is_flag else ["3" if "int" in kind or "float" in kind else "x"]
    return [name, *base, option, *value]


@pytest.mark.parametrize(("name", "option", "partners"), declared(), ids=lambda v: v if isinstance(v, str) else "")
def test_an_option_without_its_partner_is_refused(
    name: str, option: str, partners: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if (name, option) in CONDITIONAL:
        return
    monkeypatch.chdir(tmp_path)
    done = captured(*words_for(name, option, partners))
    assert done.returncode == 2, done
    assert option in done.stderr or any(p in done.stderr for p in partners), done.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", [name for name in commands() if hasattr(_module(name), "APART")])
def test_options_that_exclude_each_other_are_refused_together(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for option, others in _module(name).APART.items():
        for other in others:
            line = [word for one in (option, other) for word in words_for(name, one, ())[1:] if word.startswith("-")]
            done = captured(name, *line)
            assert done.returncode == 2, line
            assert option in done.stderr, done.stderr
    assert not any(tmp_path.iterdir())


def test_a_nest_that_is_none_is_refused_though_there_is_nothing_to_recover(tmp_path: Path) -> None:
    fixture_run.run(tmp_path, ["SN0001"], recipe=fixture_run.brief_recipe(tmp_path))
    state = ("--db", tmp_path / "station.db", "--simulate", "--device-state", tmp_path / "devices")
    assert captured("recover", "SN0001", *state, "--nest", "A").returncode == 0
    done = captured("recover", "SN0001", *state, "--nest", "Z")
    assert (done.returncode, "There is no nest 'Z'" in done.stderr) == (2, True), done


def test_a_dbc_beside_a_file_without_frames_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "turned.csv"
    table.write_text("t,ax,ay,az\n" + "".join(f"{i / 100},0.01,0.02,{1 + i % 3 / 1000}\n" for i in range(900)))
    for words in (("import",), ("segment", "--out", tmp_path / "s.csv")):
        done = captured(words[0], table, *words[1:], "--dbc", tmp_path / "none.dbc")
        assert (done.returncode, "so --dbc describes nothing in it" in done.stderr) == (2, True), done


def test_a_limit_beside_a_check_that_lists_nothing_is_refused(tmp_path: Path) -> None:
    fixture_run.run(tmp_path, ["SN0001"], recipe=fixture_run.brief_recipe(tmp_path))
    log = ("--db", tmp_path / "station.db")
    done = captured("audit", "--verify", "--limit", "3", *log)
    assert (done.returncode, "--limit belongs to a list" in done.stderr) == (2, True), done
    assert captured("audit", "--verify", "--limit", "3", "--nest", "A", *log).returncode == 0
