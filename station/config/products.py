"""Products by name: `dbc/<name>.yaml`, checked."""

import re
from pathlib import Path

from station.config.documents import load_document, validate
from station.config.search_path import find_file
from station.domain.product.product import Product
from station.errors import ProductError


def product_path(name: str, near: Path | None = None) -> Path:
    """The file of a product by name, searched around the recipe `near`, here, and as shipped."""
    if re.fullmatch(r"\w[\w.+\- ]*", name) is None:
        raise ProductError("product-name-not-plain", name=repr(name[:40]))
    return find_file(name if name.endswith(".yaml") else f"{name}.yaml", "dbc", near, ProductError)


def load_product(name: str, near: Path | None = None) -> Product:
    """The product of that name. Errors: ProductError with every mistake, its line and remedy."""
    return validate(load_document(product_path(name, near), ProductError), Product, ProductError)
