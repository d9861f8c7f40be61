"""A person turns the fixture; the station sees in the frames when the wanted face is up and still."""

from station.domain.recipe.fields import Positive, StrictModel
from station.domain.recipe.plan import PlannedVisit
from station.ports.clock import Clock


class ManualPositioner:
    """Asks and returns at once: the run then waits for the right face, and says so when a wrong one comes.

    positioner: {kind: manual, turn_s: 10}
    """

    by_hand = True
    turns_nothing = False

    class Settings(StrictModel):
        """turn_s: how long a person usually takes for one turn; only the estimate uses it."""

        turn_s: Positive = 10.0

    def __init__(self, settings: "ManualPositioner.Settings", clock: Clock) -> None:
        self._settings = settings

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Returns at once; the run says what to do."""

    def where(self) -> None:
        """A person has no encoder."""
        return

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """The usual time of one turn, s."""
        return self._settings.turn_s

    def park(self, timeout_s: float) -> None:
        """The fixture stands wherever it was left, which is safe: nothing drives it."""
