"""`station effects --write-hypothesis`: a formula of a model file adopted as an effect of the library."""

from pathlib import Path

import station.model.effects
from station import plugins
from station.cli import _output
from station.config.models import load_model
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.model.formula.effect_file import NAME, effect_source
from station.model.model_file import EFFECTS, ModelEffect, formula_size


def write_hypothesis(name: str, model: Path | None, formula: str, into: Path | None) -> int:
    """Writes the file and says what is left to do; returns the exit code. Errors: InputError."""
    if model is None:
        raise UsageError("hypothesis-without-model")
    if not NAME.fullmatch(name):
        raise UsageError("hypothesis-name", name=name[:40])
    if name in plugins.names(EFFECTS):
        raise UsageError("hypothesis-name-taken", name=name)
    chosen = _chosen(model, formula)
    assert chosen.term is not None
    folder = Path(station.model.effects.__path__[0]) if into is None else into
    path = folder / f"{name.replace('-', '_')}.py"
    if path.exists():
        raise UsageError("hypothesis-file-exists", path=str(path))
    source = chosen.term.source or "found in data"
    text = effect_source(chosen.term.term(), name, formula_size(chosen.parameters) or 1.0, source)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        replace_text(path, text)
    except OSError as exc:
        raise UsageError("option-not-written", option="--into", path=str(path), why=system_reason(exc)) from exc
    _output.print_line(render(Message("hypothesis-written", path=str(path), name=name)))
    return 0


def _chosen(model: Path, formula: str) -> ModelEffect:
    """The formula of a model file, by its name there. Errors: InputError."""
    found = [e for e in load_model(model).effects if e.term is not None]
    if not found:
        raise UsageError("hypothesis-none-in-model", file=str(model))
    chosen = [e for e in found if e.effect == formula] if formula else found
    if len(chosen) != 1:
        raise UsageError("hypothesis-which", file=str(model), names=tuple(e.effect for e in found))
    return chosen[0]
