"""`station effects --write-hypothesis`: a formula of model files adopted as an effect of the library."""

from collections.abc import Sequence
from pathlib import Path

import station.model.effects
from station import plugins
from station.cli import _output
from station.config.models import load_model
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.model.formula.effect_file import NAME, SizeMet, effect_source, is_reserved
from station.model.formula.text import formula_text
from station.model.model_file import EFFECTS, ModelEffect, formula_size
from station.model.pooling import FoundFormula, PooledFormula, pool


def write_hypothesis(name: str, models: Sequence[Path], formula: str, into: Path | None) -> int:
    """Writes the file and says what is left to do; returns the exit code. Errors: InputError."""
    if not models:
        raise UsageError("hypothesis-without-model")
    if not NAME.fullmatch(name):
        raise UsageError("hypothesis-name", name=name[:40])
    if is_reserved(name):
        raise UsageError("hypothesis-name-reserved", name=name)
    if name in plugins.names(EFFECTS):
        raise UsageError("hypothesis-name-taken", name=name)
    folder = Path(station.model.effects.__path__[0]) if into is None else into
    path = folder / f"{name.replace('-', '_')}.py"
    if path.exists():
        raise UsageError("hypothesis-file-exists", path=str(path))
    text = _source(name, models, formula)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        replace_text(path, text)
    except OSError as exc:
        raise UsageError("option-not-written", option="--into", path=str(path), why=system_reason(exc)) from exc
    _output.print_line(render(Message("hypothesis-written", path=str(path), name=name)))
    return 0


def _source(name: str, models: Sequence[Path], formula: str) -> str:
    """The text of the effect file. Errors: InputError."""
    campaigns = [FoundFormula(str(model), _chosen(model, formula)) for model in models]
    if len(campaigns) > 1:
        pooled = pool(campaigns)
        _print_pooled(pooled, len(campaigns))
        return effect_source(pooled.term, name, SizeMet(pooled.size, *pooled.sizes), pooled.source)
    found = campaigns[0].found
    assert found.term is not None
    size = SizeMet.once(formula_size(found.parameters) or 1.0)
    return effect_source(found.term.term(), name, size, found.term.source or "found in data")


def _chosen(model: Path, formula: str) -> ModelEffect:
    """The formula of a model file, by its name there. Errors: InputError."""
    found = [e for e in load_model(model).effects if e.term is not None]
    if not found:
        raise UsageError("hypothesis-none-in-model", file=str(model))
    chosen = [e for e in found if e.effect == formula] if formula else found
    if len(chosen) != 1:
        raise UsageError("hypothesis-which", file=str(model), names=tuple(e.effect for e in found))
    return chosen[0]


def _print_pooled(pooled: PooledFormula, campaigns: int) -> None:
    """What was pooled, and how well the campaigns agree."""
    _output.print_line(render(Message("pool-shared", formula=formula_text(pooled.term))))
    if pooled.dropped:
        dropped = tuple(formula_text(term) for term in pooled.dropped)
        _output.print_line(render(Message("pool-dropped", formulas=dropped)))
    for c in pooled.coefficients:
        _output.print_line(
            render(
                Message(
                    "hypothesis-pooled", campaigns=campaigns, axis=c.axis, value=c.value, std=c.std, between=c.between
                )
            )
        )
    if not pooled.agrees:
        _output.print_line(render(Message("hypothesis-disagrees")))
