"""Local gravity: WGS-84 normal gravity (Somigliana) with the second-order free-air term."""

import math

#: Standard gravity in m/s² (3rd CGPM, 1901): what "1 g" means.
STANDARD = 9.80665


def at(latitude_deg: float, altitude_m: float) -> float:
    """Normal gravity in m/s² (NIMA TR8350.2, eq. 4-1 and 4-3); local anomalies of tens of ppm are not in it."""
    sin2 = math.sin(math.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * sin2) / math.sqrt(1 - 0.00669437999013 * sin2)
    a, flattening, ratio = 6378137.0, 1 / 298.257223563, 0.00344978650684
    first = 2 / a * (1 + flattening + ratio - 2 * flattening * sin2) * altitude_m
    return surface * (1 - first + 3 * (altitude_m / a) ** 2)
