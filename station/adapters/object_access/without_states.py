"""What every device without CANopen's network management says of itself, for station.ports.device.Device."""

from station.ports.device import Emergency


class WithoutStates:
    """It always works, and sends neither heartbeats nor emergencies."""

    def state(self) -> str:
        """It has no states: it works."""
        return "operational"

    def heartbeat_age_s(self) -> float:
        """It has no heartbeat that could be late."""
        return 0.0

    def heartbeats(self) -> int:
        """It sends none."""
        return 0

    def emergencies(self) -> tuple[Emergency, ...]:
        """It sends none."""
        return ()
