"""The Earth at the site: WGS-84 normal gravity (Somigliana) with the second-order free-air term, and its turning."""

import math

import numpy as np

from station.domain.core.types import Floats

#: Standard gravity in m/s² (3rd CGPM, 1901): what "1 g" means.
STANDARD = 9.80665
#: Gravity in m/s² that no place is beyond, with room: 9.764 (Huascarán) to 9.834 (Arctic Ocean; Hirt et al., 2013).
SURFACE = (9.7, 9.9)


def normal_gravity(latitude_deg: float, altitude_m: float) -> float:
    """Normal gravity in m/s² (NIMA TR8350.2, eq. 4-1 and 4-3); local anomalies of tens of ppm are not in it."""
    sin2 = math.sin(math.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * sin2) / math.sqrt(1 - 0.00669437999013 * sin2)
    a, flattening, ratio = 6378137.0, 1 / 298.257223563, 0.00344978650684
    first = 2 / a * (1 + flattening + ratio - 2 * flattening * sin2) * altitude_m
    return surface * (1 - first + 3 * (altitude_m / a) ** 2)


#: The Earth's turning against the stars in deg/s (7.292115e-5 rad/s, NIMA TR8350.2, table 3.1).
EARTH_RATE = math.degrees(7.292115e-5)


def earth_rate(latitude_deg: float, heading_deg: float | None) -> Floats:
    """The Earth's turning (3) in the station's frame, deg/s; without a heading its vertical part alone.

    heading_deg: azimuth of the station's x axis, clockwise from north; z is up.
    """
    latitude = math.radians(latitude_deg)
    level = 0.0 if heading_deg is None else EARTH_RATE * math.cos(latitude)
    heading = math.radians(heading_deg or 0.0)
    return np.array([level * math.cos(heading), level * math.sin(heading), EARTH_RATE * math.sin(latitude)])
