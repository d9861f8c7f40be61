"""What the runner is handed: the station's ports and settings, and the job to do on them."""

from collections.abc import Callable
from dataclasses import dataclass

from station.config.settings import Settings
from station.domain.can.sensor_layout import SensorLayout
from station.domain.product.product import Product
from station.domain.recipe.recipe import Recipe
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.ports.device import Device
from station.ports.foreign_traffic import ForeignTraffic
from station.ports.positioner import Positioner
from station.ports.store import Store
from station.service.alerts import AlertBook


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be done: the recipe and the product, with the text and hash that the record keeps of them.

    layout: the product's frames, found in its DBC; takes_in: causes that a model has told the calibration of; plain:
    the recipe as it would be without them, where that is another one.
    """

    recipe: Recipe
    recipe_hash: str
    recipe_json: str
    product: Product
    product_json: str
    layout: SensorLayout
    compensated_causes: tuple[str, ...] = ()
    plain: Recipe | None = None

    @property
    def gold_node(self) -> int | None:
        """Node of the gold reference that is read beside the units; None where the recipe has another truth."""
        gold = self.recipe.reference.gold
        return gold.node if gold is not None and self.recipe.reference.source == "gold" else None

    def ids(self, node: int) -> tuple[int, ...]:
        """Identifiers that belong to a unit's evidence: its own frames, and the gold reference's."""
        gold = () if self.gold_node is None else self.layout.ids(self.gold_node)
        return (*self.layout.ids(node), *gold)


@dataclass(frozen=True, slots=True)
class Station:
    """What it is done with. device: node id → the device there; foreign: who else commands the devices; simulated: rig
    and devices are; alerts: of the watch, which the log is to hold."""

    settings: Settings
    config_hash: str
    bus: Bus
    positioner: Positioner
    store: Store
    clock: Clock
    device: Callable[[int], Device]
    foreign: ForeignTraffic
    simulated: bool = False
    alerts: Callable[[], AlertBook] = AlertBook
