"""What every positioner keeps to; a new file in the folder is tested without being told."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from station import plugins
from station.adapters.clock import VirtualClock
from station.domain.core import rotation
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.position import UP
from station.ports.positioner import Positioner

PACKAGE = "station.adapters.positioner"
KINDS = plugins.names(PACKAGE)


def stop(up: str, seat_deg: float = 0.0) -> PlannedVisit:
    nest = rotation.shortest(UP[up], UP["+z"])
    seat = rotation.about(np.array([0.0, 0.0, 1.0]), seat_deg)
    return PlannedVisit(0, 0, up, "home", nest, seat, (nest @ seat).T @ UP["+z"], None)


def make(kind: str, clock: VirtualClock, **options: Any) -> Positioner:
    made: Any = plugins.load(PACKAGE, kind)
    positioner: Positioner = made(made.Settings(**options), clock)
    return positioner


@pytest.mark.parametrize("kind", KINDS)
def test_its_settings_have_defaults_and_refuse_an_unknown_key(kind: str) -> None:
    settings: Any = plugins.load(PACKAGE, kind)
    settings.Settings()
    with pytest.raises(ValidationError):
        settings.Settings(no_such_key=1)


@pytest.mark.parametrize("kind", KINDS)
def test_its_docstring_is_the_yaml_to_paste(kind: str) -> None:
    assert f"positioner: {{kind: {kind}" in (plugins.load(PACKAGE, kind).__doc__ or "")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("up", sorted(UP))
def test_it_arrives_in_time_and_knows_where_it_is(kind: str, up: str) -> None:
    clock = VirtualClock()
    positioner = make(kind, clock)
    begin = clock.monotonic_s()
    positioner.move(stop(up), 60.0)
    assert clock.monotonic_s() - begin <= 60.0
    where = positioner.where()
    if positioner.by_hand:
        assert where is None
    else:
        assert where is not None
        assert np.linalg.norm(rotation.to_vector(where.attitude @ stop(up).nest.T)) < np.deg2rad(1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_move_takes_about_what_it_said(kind: str) -> None:
    clock = VirtualClock()
    positioner = make(kind, clock)
    assert positioner.estimate_s(None, stop("+z")) >= 0
    before = clock.monotonic_s()
    positioner.move(stop("+x"), 60.0)
    took = clock.monotonic_s() - before
    assert positioner.by_hand or took == pytest.approx(positioner.estimate_s(None, stop("+x")), rel=0.05, abs=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_it_parks_from_anywhere_and_twice(kind: str) -> None:
    clock = VirtualClock()
    positioner = make(kind, clock)
    positioner.park(20.0)
    positioner.move(stop("-x"), 60.0)
    positioner.park(20.0)
    positioner.park(20.0)
    where = positioner.where()
    assert where is None or np.allclose(where.attitude, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_building_one_takes_no_time(kind: str) -> None:
    clock = VirtualClock()
    make(kind, clock)
    assert clock.monotonic_s() == 0.0
