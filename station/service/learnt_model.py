"""What a simulation has learnt goes into the calibration of a run: the causes that are the device's own."""

from dataclasses import replace
from pathlib import Path

from station.config.documents import canonical
from station.config.models import load_model
from station.config.recipes import recipe_hash
from station.messages import Message, render
from station.model.compensated import compensate
from station.service.station import Job


def with_model(job: Job, path: Path | None) -> tuple[Job, tuple[str, ...]]:
    """The job whose calibration knows a model's causes, and what the operator should know of that.

    Errors: InputError of the model file; RecipeError where the recipe's positions do not determine what is needed.
    """
    if path is None:
        return job, ()
    matrix = job.product.map.matrix
    gains_only = matrix is None or matrix.order == "diagonal"
    found = compensate(job.recipe, load_model(path, job.recipe.unit), gains_only=gains_only)
    notices = [f"{path}: {reason}" for reason in found.uncompensated]
    if found.causes:
        notices.insert(0, render(Message("model-causes-compensated", file=str(path), causes=found.causes)))
    if found.recipe == job.recipe:
        return replace(job, compensated_causes=found.causes), tuple(notices)
    whole = replace(
        job,
        recipe=found.recipe,
        recipe_hash=recipe_hash(found.recipe),
        recipe_json=canonical(found.recipe),
        compensated_causes=found.causes,
        plain=job.recipe,
    )
    return whole, tuple(notices)
