"""plant.yaml → frozen settings of a plant (schema `station.plant/1`)."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from station.config.documents import load_document, validate
from station.config.settings import PathText
from station.domain.recipe.fields import Name, Positive, StrictModel
from station.errors import ConfigError

TokenHash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class PlantStation(StrictModel):
    """A station that may ship. token_sha256: of its token, hex; certificate: the common name in its client certificate;
    former_names: further names that its attempts may bear."""

    name: Name
    public_key: PathText
    token_sha256: TokenHash | None = None
    certificate: Annotated[str, Field(max_length=64)] = ""
    former_names: Annotated[tuple[Name, ...], Field(max_length=32)] = ()

    @model_validator(mode="after")
    def _has_an_entrance(self) -> Self:
        if not (self.token_sha256 or self.certificate):
            raise ValueError("a station needs token_sha256 or certificate; `station plant register` makes a token")
        return self


class TlsSettings(StrictModel):
    """The plant's certificate and key, PEM; authority: who signs the stations' certificates, PEM."""

    certificate: PathText
    key: PathText
    authority: PathText = ""


class RetentionSettings(StrictModel):
    """For how long raw frames are kept, by the outcome of their attempt; left out: for ever. Their hashes stay."""

    pass_days: Positive | None = None
    other_days: Positive | None = None


class PlantSettings(StrictModel):
    """Everything about a plant. database: a PostgreSQL address; objects: a folder or an fsspec address of raw frames;
    signing_key: with it the plant is a witness, too."""

    schema_: Annotated[Literal["station.plant/1"], Field(alias="schema")] = "station.plant/1"
    database: Annotated[str, Field(max_length=2000, pattern=r"^postgres(ql)?://[^\x00-\x20\x7f]*$")]
    objects: PathText = "frames"
    signing_key: PathText = ""
    tls: TlsSettings | None = None
    stations: Annotated[tuple[PlantStation, ...], Field(max_length=1000)] = ()
    retention: RetentionSettings = RetentionSettings()
    most_portion_bytes: Annotated[int, Field(ge=65_536, le=1_073_741_824)] = 134_217_728

    @field_validator("stations", mode="before")
    @classmethod
    def _none_yet(cls, value: Any) -> Any:
        """`stations:` with nothing behind it."""
        return () if value is None else value

    @model_validator(mode="after")
    def _stations_differ(self) -> Self:
        for what in ("name", "token_sha256", "certificate"):
            given = [value for s in self.stations if (value := getattr(s, what))]
            if len(set(given)) < len(given):
                raise ValueError(f"two stations have the same {what}")
        return self


def load_plant(path: Path) -> PlantSettings:
    """The plant's settings; files are named from its folder. Errors: ConfigError."""
    return validate(load_document(path, ConfigError), PlantSettings, ConfigError)
