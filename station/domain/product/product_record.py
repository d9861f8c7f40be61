"""A product with its frames as one text, so that the log can refit an attempt without any file."""

import json
from dataclasses import asdict
from typing import Any

from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.product.product import Product
from station.domain.records.json_object import json_object


def dump(product: Product, layout: SensorLayout) -> str:
    """Product and resolved frames as JSON, the same for the same content."""
    document = {
        "product": product.model_dump(mode="json", by_alias=True),
        "sample": asdict(layout.sample),
        "others": [asdict(message) for message in layout.others],
        "temperature": None if layout.temperature is None else asdict(layout.temperature),
    }
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def load(text: str) -> tuple[Product, SensorLayout]:
    """What `dump` wrote."""
    document = json.loads(text)
    product = Product.model_validate(document["product"])
    temperature = document["temperature"]
    others = tuple(_frame(message) for message in document.get("others", ()))  # records before 0.3 have none
    sample, slow = _frame(document["sample"]), None if temperature is None else _frame(temperature)
    return product, SensorLayout(product.frames, sample, slow, others)


def name_in(text: str) -> str:
    """What a kept product is called; "" where the text says nothing of the kind."""
    try:
        name = json_object(text)["product"]["name"]
    except (ValueError, KeyError, TypeError):
        return ""
    return name.replace("\x00", "").encode(errors="ignore").decode() if isinstance(name, str) else ""


def _frame(document: dict[str, Any]) -> FrameLayout:
    signals = tuple(SignalLayout(**{**s, "selected_by": tuple(s["selected_by"])}) for s in document["signals"])
    return FrameLayout(**{**document, "signals": signals})
