"""What a simulation was made of, as a document: schema `station.truth/1`."""

from collections.abc import Iterable
from typing import Any

from station import __version__
from station.model.simulate import Job, Made


def document(job: Job, made: Iterable[Made]) -> dict[str, Any]:
    """The truth about all parts of a job, in the contracts' parameter form {name, axis, of, value, unit}.

    offset and matrix of a unit are what is no defect: measured = matrix · true + offset + what the effects add.
    """
    units: list[dict[str, Any]] = []
    effects: dict[str, dict[tuple[object, ...], dict[str, object]]] = {}
    for part in made:
        for name, offset, matrix in zip(part.units, part.base.offset, part.base.matrix, strict=True):
            units.append({"serial": name, "offset": offset.tolist(), "matrix": matrix.tolist()})
        for key, acting in part.active.items():
            names = part.scene.group(acting.of)[1]
            told = acting.effect.told(names, acting.coefficients, job.recipe.unit)
            # Parts of a fleet share what is common; it is told once.
            effects.setdefault(key, {}).update({(p["name"], p["axis"], p["of"]): p for p in told})
    noise = job.noise
    return {
        "schema": "station.truth/1",
        "software": __version__,
        "seed": job.seed,
        "recipe": {"name": job.recipe.name, "version": job.recipe.version},
        "unit": job.recipe.unit,
        "noise": {"density": noise.density, "flicker": noise.flicker},
        "units": units,
        "effects": [
            {"effect": key.partition("/")[2], "parameters": list(told.values())} for key, told in effects.items()
        ],
    }
