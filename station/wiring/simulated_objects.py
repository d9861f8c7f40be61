"""The objects of simulated devices: those of the product's EDS or of its map, none of a device that only sends."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from station.adapters.canopen import eds
from station.domain.product.mapped_objects import mapped_objects
from station.domain.product.object_dictionary import ObjectDictionary
from station.domain.product.product import Product
from station.errors import ProductError


def simulated_objects(product: Product, where: Path) -> Callable[[int], ObjectDictionary]:
    """node → its objects, read once. where: the product's file. Errors: ProductError."""
    if product.eds is not None:
        return cache(partial(eds.load, where.parent / product.eds, used=frozenset()))
    if product.map.protocol in ("uds", "template"):
        return cache(partial(mapped_objects, product))
    if product.map.protocol != "none":
        raise ProductError("product-without-eds", file=str(where))
    return ObjectDictionary
