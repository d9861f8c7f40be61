"""What the integration tests share: a simulated device on a virtual bus."""

from collections.abc import Callable, Iterator

import pytest

from tests.fakes.device_rig import DeviceRig


@pytest.fixture
def rig() -> Iterator[Callable[..., DeviceRig]]:
    """Makes device rigs (see tests/fakes/device_rig.py); takes them off their buses at the end."""
    rigs = []

    def make(**options: object) -> DeviceRig:
        rigs.append(DeviceRig(**options))  # type: ignore[arg-type]
        return rigs[-1]

    yield make
    for each in rigs:
        each.close()
