"""What a simulation was made of, as a document: schema `station.truth/1`."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from station import __version__
from station.model.simulate import SimulatedUnits, SimulationJob


@dataclass(slots=True)
class Truth:
    """The truth about all parts of a job, taken in part by part: of each unit only what the document says is kept."""

    job: SimulationJob
    units: list[dict[str, Any]] = field(default_factory=list)
    effects: dict[str, dict[tuple[object, ...], dict[str, object]]] = field(default_factory=dict)

    def add(self, part: SimulatedUnits) -> None:
        """Takes in some units."""
        for name, offset, matrix in zip(part.units, part.base.offset, part.base.matrix, strict=True):
            self.units.append({"serial": name, "offset": offset.tolist(), "matrix": matrix.tolist()})
        for key, acting in part.active.items():
            names = part.scene.group(acting.of)[1]
            rows = acting.effect.parameter_rows(names, acting.coefficients, self.job.recipe.unit)
            # Parts of a fleet share what is common; it is told once.
            self.effects.setdefault(key, {}).update({(p["name"], p["axis"], p["of"]): p for p in rows})

    def document(self) -> dict[str, Any]:
        """In the parameter form of docs/formats.md {name, axis, of, value, unit}.

        offset and matrix of a unit are what is no defect: measured = matrix · true + offset + what the effects add.
        """
        job, noise = self.job, self.job.noise
        return {
            "schema": "station.truth/1",
            "software": __version__,
            "seed": job.seed,
            "recipe": {"name": job.recipe.name, "version": job.recipe.version},
            "unit": job.recipe.unit,
            "noise": {"density": noise.density, "flicker": noise.flicker},
            "units": self.units,
            "effects": [
                {"effect": key.partition("/")[2], "parameters": list(rows.values())}
                for key, rows in self.effects.items()
            ],
        }


def document(job: SimulationJob, made: Iterable[SimulatedUnits]) -> dict[str, Any]:
    """The truth about all parts of a job."""
    truth = Truth(job)
    for part in made:
        truth.add(part)
    return truth.document()
