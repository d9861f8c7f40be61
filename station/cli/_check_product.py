"""A product checked without a recipe: which signals it reads, what its map writes, whether its EDS agrees."""

from station.cli import _output
from station.domain.can.sensor_layout import SensorLayout
from station.domain.product.product import Product
from station.messages import Message
from station.wiring.jobs import check_product


def check_product_alone(name: str, *, as_json: bool) -> int:
    """Checks and prints; 0 when the product is sound. Errors: ProductError."""
    product, layout, source = check_product(name)
    signals = [signal.name for signal in layout.axes]
    writes = [key for key, _ in product.map.coefficients()]
    if as_json:
        files = {"product": str(source.product), "dbc": str(source.dbc), "eds": source.eds and str(source.eds)}
        document = {"schema": "station.check/1", "product": {"name": product.name, "sensor": product.sensor}}
        _output.print_json({**document, "files": files, "signals": signals, "writes": writes})
        return 0
    eds = None if source.eds is None else source.eds.name
    for message in _messages(product, layout, signals, writes, eds):
        _output.print_message(message)
    return 0


def _messages(
    product: Product, layout: SensorLayout, signals: list[str], writes: list[str], eds: str | None
) -> tuple[Message, ...]:
    unit = product.frames.unit or layout.axes[0].unit or "?"
    where = Message(
        "check-product-reads", product=product.name, sensor=product.sensor, message=layout.sample.name,
        signals=tuple(signals), unit=unit,
    )  # fmt: skip
    kept = Message("check-product-writes", count=len(writes)) if writes else Message("check-product-writes-nothing")
    fits = Message("check-product-without-eds") if eds is None else Message("check-product-fits", eds=eds)
    return where, kept, fits
