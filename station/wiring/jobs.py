"""A recipe by name or path → everything that is to be done: recipe, product, frames."""

from dataclasses import dataclass
from pathlib import Path

from station.adapters.dbc import read_layouts
from station.config.documents import canonical, load_document, validate
from station.config.products import product_path
from station.config.recipes import load_recipe, recipe_hash, recipe_path
from station.domain.can.sensor_layout import SensorLayout, resolve, used_signals
from station.domain.methods import decision_rule, method
from station.domain.product import map_check, product_record
from station.domain.product.device_map import DeviceMap
from station.domain.product.frame_pattern import parse_pattern
from station.domain.product.pdo_check import pdo_mismatches
from station.domain.product.product import Product
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import quantities
from station.errors import ProductError, RecipeError
from station.messages import Message, system_reason
from station.service.station import Job


@dataclass(frozen=True, slots=True)
class Source:
    """The files a job was read from. eds: of the product, or None."""

    recipe: Path
    product: Path
    dbc: Path
    eds: Path | None


def load_job(name: str | Path) -> tuple[Job, Source]:
    """Reads and checks the recipe and all it names. Errors: RecipeError, ProductError."""
    path = recipe_path(name)
    recipe = load_recipe(path)
    if recipe.product is None:
        raise RecipeError("recipe-without-product", file=str(path))
    try:
        method.of(recipe).check(recipe)
    except RecipeError as exc:
        raise RecipeError("file-reason", file=str(path), reason=exc.message) from None
    try:
        where = product_path(recipe.product, path)
    except ProductError as exc:
        raise RecipeError("file-reason", file=str(path), reason=exc.message) from None
    product, layout, dbc = _load_product(where)
    layout = layout.scaled(_unit_factors(dbc, recipe, layout), recipe.unit)
    _check_fit(path, recipe, where, product)
    eds = _eds(where, product)
    _check_map(where, product, eds, layout)
    job = Job(
        recipe=recipe,
        recipe_hash=recipe_hash(recipe),
        recipe_json=canonical(recipe),
        product=product,
        product_json=product_record.dump(product, layout),
        layout=layout,
    )
    return job, Source(path, where, dbc, eds)


def check_product(name: str) -> tuple[Product, SensorLayout, Source]:
    """A product by name or path without a recipe: roles, signals, and map against EDS. Errors: ProductError."""
    where = Path(name) if name.endswith((".yaml", ".yml")) else product_path(name)
    product, layout, dbc = _load_product(where)
    eds = _eds(where, product)
    _check_map(where, product, eds, layout)
    return product, layout, Source(where, where, dbc, eds)


def _load_product(where: Path) -> tuple[Product, SensorLayout, Path]:
    product = validate(load_document(where, ProductError), Product, ProductError)
    dbc = where.parent / product.frames.dbc
    _check_there(where, "frames.dbc", dbc)
    return product, resolve(product.frames, read_layouts(dbc, used_signals(product.frames))), dbc


def _eds(where: Path, product: Product) -> Path | None:
    if product.eds is None:
        return None
    eds = where.parent / product.eds
    _check_there(where, "eds", eds)
    return eds


def _check_there(where: Path, key: str, named: Path) -> None:
    """Whoever mistyped a name looks for it in the file that holds it. Errors: ProductError."""
    if not named.is_file():
        raise ProductError("product-names-no-file", file=str(where), key=key, named=str(named))
    try:
        with named.open("rb") as file:
            file.read(1)
    except OSError as exc:
        why = system_reason(exc)
        raise ProductError("product-file-unreadable", file=str(where), key=key, named=str(named), why=why) from None


def _check_fit(path: Path, recipe: Recipe, where: Path, product: Product) -> None:
    if product.sensor != recipe.sensor:
        raise RecipeError(
            "recipe-product-sensor", file=str(path), sensor=recipe.sensor, product=str(where), other=product.sensor
        )

    if (named := len(product.frames.sample.axes)) != recipe.axes:
        raise ProductError("axes-of-sensor", file=str(where), sensor=product.sensor, named=named, wanted=recipe.axes)
    if product.map.writes and (missing := _not_kept(recipe, product.map)) is not None:
        raise RecipeError("file-reason", file=str(path), reason=Message(missing))


def _not_kept(recipe: Recipe, device_map: DeviceMap) -> str | None:
    """What is wrong where the recipe finds coefficients that the device has no objects for: every unit would fail."""
    found = decision_rule.estimated(recipe)
    if device_map.matrix is None:
        return "product-without-gain" if found else None
    return "product-without-cross-axis" if device_map.matrix.order == "diagonal" and "cross_axis" in found else None


def _check_map(where: Path, product: Product, eds: Path | None, layout: SensorLayout) -> None:
    """Refuses a device map that leaves open what the readings are, or that contradicts the EDS: the device would refuse
    it half-way through a write; and frames that the EDS maps otherwise: they would be read wrong in silence."""
    if product.map.writes and product.map.output is None:
        raise ProductError("map-without-output", file=str(where))
    _check_protocol(where, product)
    if eds is None:
        return
    from station.adapters.canopen.eds import load

    dictionary = load(eds, product.frames.node_of_dbc, map_check.addresses(product.map))
    if wrong := map_check.mismatches(product.map, dictionary):
        raise ProductError("map-contradicts-eds", file=str(where), eds=eds.name, mismatches=wrong)
    if product.map.protocol == "canopen" and (wrong := pdo_mismatches(layout, product.map, dictionary)):
        dbc = product.frames.dbc
        raise ProductError("frames-contradict-eds", file=str(where), dbc=dbc, eds=eds.name, mismatches=wrong)


def _check_protocol(where: Path, product: Product) -> None:
    """Refuses what the product's protocol cannot read or write."""
    device_map = product.map
    if device_map.protocol == "uds":
        for key in ("vendor", "product", "device_type", "revision_at_least"):
            if getattr(product.identity, key) is not None:
                raise ProductError("identity-without-canopen", file=str(where), key=key, protocol="uds")
    if device_map.template is not None and device_map.record is not None:
        room = parse_pattern(device_map.template.write.send).width("value")
        if device_map.record.length > room:
            length = device_map.record.length
            raise ProductError("object-too-long", file=str(where), name="record", length=length, room=room)


def _unit_factors(dbc: Path, recipe: Recipe, layout: SensorLayout) -> dict[str, float]:
    """What each signal's physical value is multiplied by to be in the recipe's unit; no unit is taken for that one."""
    factors: dict[str, float] = {}
    for name in (name for names in layout.map.sample.axes for name in names):
        given = layout.map.unit or layout.signal(name).unit
        factor = 1.0 if given.strip() in ("", recipe.unit) else quantities.unit_factor(given, recipe.unit)
        if factor is None:
            known = quantities.units(recipe.unit)
            raise ProductError("dbc-other-unit", file=str(dbc), unit=given, known=known)
        factors[name] = factor
    return factors
