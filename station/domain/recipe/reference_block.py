"""The `reference` block: where the true stimulus comes from, and how well it is known."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from station.domain.recipe import gravity
from station.domain.recipe.fields import AngleStd, Day, Finite, Name, NotNegative, Positive, StrictModel, Vector
from station.errors import InvalidValue


class Site(StrictModel):
    """Where the station stands, for local gravity and the Earth's turning.

    heading_deg: azimuth of the station's x axis, clockwise from north; wanted by sensors that feel the Earth's turning.
    """

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    altitude_m: Annotated[float, Field(ge=-500, le=9000)] = 0.0
    anomaly_std_ppm: NotNegative = 30.0
    heading_deg: Finite | None = None


class Gravimeter(StrictModel):
    """Local gravity as a gravimeter measured it, with its standard uncertainty, both in m/s²."""

    value_m_s2: Annotated[float, Field(ge=gravity.SURFACE[0], le=gravity.SURFACE[1])]
    std_m_s2: NotNegative


class Reproducibility(StrictModel):
    """What a coefficient differs by when the same unit is measured again on other days, in other nests, after
    reseating (Type A): standard deviations, offset in the recipe's unit; dof: degrees of freedom they come from."""

    offset: NotNegative = 0.0
    gain: NotNegative = 0.0
    cross_axis: NotNegative = 0.0
    dof: Annotated[float, Field(ge=1)]


class ResidualHistory(StrictModel):
    """What residuals of earlier units came to: their variance in units of the stated one (χ²/ν), and degrees of freedom
    that it counts with beside a unit's own."""

    ratio: Positive
    dof: NotNegative


class ReferenceCertificate(StrictModel):
    """Traceability of one reference: what it is, number of its certificate, due date (ISO), who issued it."""

    item: Name
    number: Annotated[str, Field(min_length=1)]
    due: Day
    issuer: str = ""


class GoldReference(StrictModel):
    """A gold reference sensor in the same orientation, with its own calibration, uncertainty and due date.

    offset, matrix: measured = matrix · true + offset, in the recipe's unit; offset_std, gain_std: standard
    uncertainty per axis; seat_std_deg: how well its axes agree with the nest's; node: its node id on the bus;
    certificate: number of its certificate.
    """

    serial: Name
    offset: Vector = (0.0, 0.0, 0.0)
    matrix: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offset_std: NotNegative | None = None
    gain_std: NotNegative | None = None
    seat_std_deg: AngleStd | None = None
    due: Day
    certificate: str = ""
    node: Annotated[int, Field(ge=1, le=127)] | None = None

    @model_validator(mode="after")
    def _check_invertible(self) -> Self:
        if not np.linalg.det(self.matrix) > 1e-6:
            raise InvalidValue("gold-matrix-singular")
        return self


class Reference(StrictModel):
    """Where the true stimulus comes from. magnitude and vector in the recipe's unit.

    Standard uncertainties: magnitude_std in that unit; pose_std_deg of each pose by itself, about each axis;
    nest_std_deg: how the nest sits on the fixture, base_std_deg: how the fixture stands, field_std_deg: direction of
    a field, each the same for all poses; thermometer_std_degC. One that is not stated takes the default of
    station.domain.recipe.assumptions, with its source. certificates: traceability of fixture, thermometer, field, …
    """

    source: Literal["gravity", "field", "rate", "gold"]
    magnitude: Positive | None = None
    magnitude_std: NotNegative | None = None
    vector: Vector | None = None
    site: Site | None = None
    gravimeter: Gravimeter | None = None
    pose: Literal["known", "unknown"] = "known"
    pose_std_deg: AngleStd | None = None
    nest_std_deg: AngleStd | None = None
    base_std_deg: AngleStd | None = None
    field_std_deg: AngleStd | None = None
    thermometer_std_degC: NotNegative | None = None
    gold: GoldReference | None = None
    certificates: tuple[ReferenceCertificate, ...] = ()

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.source == "gold" and self.gold is None:
            raise InvalidValue("source-gold-incomplete")
        if self.source == "field" and self.vector is None and self.magnitude is None:
            raise InvalidValue("source-field-incomplete")
        if self.site is not None and self.source == "field":
            raise InvalidValue("site-with-field")
        if self.site is not None and self.source == "gravity" and "altitude_m" not in self.site.model_fields_set:
            raise InvalidValue("site-without-altitude")
        if self.gravimeter is not None and (self.source != "gravity" or self.site is not None):
            raise InvalidValue("gravimeter-elsewhere")
        return self

    def strength(self) -> float:
        """Magnitude of the true stimulus in the recipe's unit (1 for a rate, whose positions carry their own)."""
        if self.site is not None and self.source != "rate":
            return gravity.normal_gravity(self.site.latitude_deg, self.site.altitude_m) / gravity.STANDARD
        if self.gravimeter is not None:
            return self.gravimeter.value_m_s2 / gravity.STANDARD
        if self.magnitude is not None:
            return self.magnitude
        return float(np.linalg.norm(self.vector)) if self.vector is not None else 1.0

    def relative_std(self) -> float:
        """Standard uncertainty of the magnitude, relative: local anomalies at a site, else as stated (0 if not)."""
        if self.site is not None and self.source != "rate":
            return self.site.anomaly_std_ppm * 1e-6
        if self.gravimeter is not None:
            return self.gravimeter.std_m_s2 / self.gravimeter.value_m_s2
        return (self.magnitude_std or 0.0) / self.strength()
