"""Gravity at places where it has been published, and the Earth's turning."""

import numpy as np
import pytest

from station.domain.recipe import gravity

#: Place: latitude, height, m/s² by the WGS-84 formula with free air, as national tables print it to 5–10 ppm.
PLACES = {
    "equator": (0.0, 0.0, 9.780325),
    "45 degrees": (45.0, 0.0, 9.806199),
    "pole": (90.0, 0.0, 9.832185),
    "Singapore": (1.29, 0.0, 9.78035),
    "Mexico City": (19.43, 2240.0, 9.77913),
    "Denver": (39.74, 1609.0, 9.79650),
    "Munich": (48.14, 520.0, 9.80743),
    "Helsinki": (60.17, 0.0, 9.8192),
}


@pytest.mark.parametrize("place", list(PLACES))
def test_site_gravity_is_the_published_one(place: str) -> None:
    latitude, altitude, published = PLACES[place]
    assert gravity.normal_gravity(latitude, altitude) == pytest.approx(published, rel=20e-6)


def test_up_is_lighter() -> None:
    """−31.5 ppm per 100 m (0.3086 mGal/m)."""
    assert (gravity.normal_gravity(45, 100) / gravity.normal_gravity(45, 0) - 1) * 1e6 == pytest.approx(-31.5, abs=0.1)


def test_the_earth_turns_once_in_a_sidereal_day() -> None:
    turned_deg = gravity.EARTH_RATE * 86164.0905
    assert turned_deg == pytest.approx(360.0, rel=1e-6)


@pytest.mark.parametrize(("latitude", "heading"), [(0.0, 0.0), (48.0, 30.0), (-35.0, 200.0), (90.0, 0.0)])
def test_the_rate_in_the_stations_frame(latitude: float, heading: float) -> None:
    found = gravity.earth_rate(latitude, heading)
    assert np.linalg.norm(found) == pytest.approx(gravity.EARTH_RATE)
    assert found[2] == pytest.approx(gravity.EARTH_RATE * np.sin(np.deg2rad(latitude)))
    # North lies at azimuth −heading from the station's x axis, seen clockwise from above.
    assert np.degrees(np.arctan2(found[1], found[0])) % 360 == pytest.approx(heading % 360) or latitude == 90
    assert gravity.earth_rate(latitude, None)[:2].tolist() == [0.0, 0.0]
