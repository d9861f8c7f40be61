"""config.yaml → frozen settings of one station (schema `station.config/1`)."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator

from station.config.documents import Document, load_document, validate
from station.config.line import LineSettings
from station.config.search_path import shipped_folder
from station.domain.recipe.fields import Name, Positive, StrictModel
from station.errors import ConfigError, InvalidValue

Node = Annotated[int, Field(ge=1, le=127)]
PathText = Annotated[str, Field(max_length=4096, pattern=r"^[^\x00-\x1f\x7f]*$")]
ShortText = Annotated[str, Field(max_length=64, pattern=r"^[^\x00-\x1f\x7f]*$")]
#: Names and addresses as they stand in a register of companies.
PartyText = Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]


class AdapterSettings(BaseModel):
    """A block whose other keys are the options of the adapter that it names, checked by it."""

    model_config = ConfigDict(frozen=True, extra="allow")

    @property
    def options(self) -> dict[str, Any]:
        """The adapter's own keys."""
        return dict(self.model_extra or {})


def _as_text(channel: Any) -> Any:
    return str(channel) if isinstance(channel, int) and not isinstance(channel, bool) else channel


class BusSettings(AdapterSettings):
    """Which bus, by file name, and its channel; some drivers number theirs."""

    interface: Name = "socketcan"
    channel: Annotated[PathText, BeforeValidator(_as_text, json_schema_input_type=PathText | int)] = "can0"


class Nest(StrictModel):
    """One seat of the fixture and the node id of the device in it; bus: one of `buses`, where there are several."""

    name: Name
    node: Node
    bus: Name | None = None


class PositionerSettings(AdapterSettings):
    """Which positioner, by file name. Left out, a person turns the fixture and is asked for each position."""

    kind: Name = "manual"


class Timeouts(StrictModel):
    """How long each thing may take before it counts as failed, s."""

    sdo_s: Positive = 1.0
    save_s: Positive = 5.0
    boot_s: Positive = 5.0
    move_s: Positive = 60.0
    settle_s: Positive = 10.0
    face_s: Positive = 300.0
    park_s: Positive = 20.0


class GoldenSettings(StrictModel):
    """Golden and known-bad units that must come out as registered, every so many hours, before anything is made."""

    file: PathText = "golden.json"
    every_h: Positive = 8.0


class AnchorSettings(StrictModel):
    """A folder elsewhere that keeps the log's head; write_once: a new file each time, none ever written over."""

    folder: PathText
    write_once: bool = False


WebAddress = Annotated[str, Field(max_length=2000, pattern=r"^https?://[^\x00-\x20\x7f]+$")]
MailAddress = Annotated[str, Field(max_length=254, pattern=r"^[^\x00-\x20\x7f@<>,;]+@[^\x00-\x20\x7f@<>,;]+$")]


class WitnessSettings(StrictModel):
    """A witness of the log: its address, its public key (PEM), and how long the station waits for it."""

    url: Annotated[str, Field(max_length=2000, pattern=r"^https?://[^\x00-\x20\x7f]+$")]
    public_key: PathText
    timeout_s: Positive = 2.0


class ReceiverSettings(StrictModel):
    """A plant that gets the log's records: its address, and the token or the certificate by which it knows the station.

    token_file: holds the token; certificate, key: the station's own, PEM; authority: who signed the plant's, PEM.
    portion_bytes: of one portion; bytes_per_s: on average, left out: as fast as it goes.
    """

    name: Name = "plant"
    url: Annotated[str, Field(max_length=2000, pattern=r"^https?://[^\x00-\x20\x7f]+$")]
    token_file: PathText = ""
    certificate: PathText = ""
    key: PathText = ""
    authority: PathText = ""
    timeout_s: Positive = 30.0
    portion_bytes: Annotated[int, Field(ge=4096, le=8_388_608)] = 1_048_576
    bytes_per_s: Positive | None = None


class MailSettings(StrictModel):
    """Mail by SMTP. security: starttls, tls, or none on a network of one's own; password_file: holds that of `user`."""

    host: Annotated[str, Field(min_length=1, max_length=253, pattern=r"^[^\x00-\x20\x7f]+$")]
    port: Annotated[int, Field(ge=1, le=65535)] = 587
    security: Literal["starttls", "tls", "none"] = "starttls"
    user: ShortText = ""
    password_file: PathText = ""
    sender: MailAddress
    to: Annotated[tuple[MailAddress, ...], Field(min_length=1, max_length=20)]


class AlertSettings(StrictModel):
    """Where alerts of the watch go beside the log and the page. run_length: loads to a false alarm, on average."""

    webhooks: Annotated[tuple[WebAddress, ...], Field(max_length=8)] = ()
    mail: MailSettings | None = None
    run_length: Annotated[int, Field(ge=10, le=1_000_000)] = 1000


def _check_country(code: str) -> str:
    if re.fullmatch("[A-Z]{2}", code) is None:
        raise InvalidValue("country-unknown", given=code[:40])
    return code


class PartySettings(StrictModel):
    """Name and address of a laboratory or a customer, for certificates; country: ISO 3166-1, two letters."""

    name: PartyText = ""
    street: PartyText = ""
    city: PartyText = ""
    post_code: PartyText = ""
    country: Annotated[str, Field(json_schema_extra={"pattern": "^[A-Z]{2}$"}), AfterValidator(_check_country)] = "DE"


class CertificateSettings(StrictModel):
    """Who issues certificates, for whom, who signs, and the number of the accreditation ('' without one); place: where
    units are calibrated, if not on the laboratory's own premises."""

    laboratory: PartySettings = PartySettings()
    customer: PartySettings = PartySettings()
    signatory: PartyText = ""
    accreditation: PartyText = ""
    place: Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"] = "laboratory"

    def document(self) -> dict[str, Any]:
        """As plain values."""
        return self.model_dump()


class RehearsalSettings(StrictModel):
    """A bench without hardware: where its simulated devices keep what they save, and what is wrong with which of them.

    faults: `[SERIAL/]KIND[:key=value,…]`, as `station run --fault` takes them.
    """

    device_state: PathText = "devices"
    faults: Annotated[tuple[ShortText, ...], Field(max_length=1000)] = ()


class Settings(StrictModel):
    """Everything about this station that is not in a recipe."""

    schema_: Annotated[Literal["station.config/1"], Field(alias="schema")] = "station.config/1"
    station: Name = "station-1"
    fixture: ShortText = ""
    operator: ShortText = ""
    lot: ShortText = ""
    bus: BusSettings = BusSettings()
    buses: Annotated[dict[Name, BusSettings], Field(max_length=16)] = Field(default_factory=dict)
    nests: Annotated[tuple[Nest, ...], Field(min_length=1, max_length=127)]
    positioner: PositionerSettings = PositionerSettings()
    recipe: ShortText = "six-point"
    database: PathText = "station.db"
    signing_key: PathText = ""
    trusted_key: PathText = ""
    anchors: Annotated[tuple[AnchorSettings, ...], Field(max_length=8)] = ()
    witness: WitnessSettings | None = None
    receivers: Annotated[tuple[ReceiverSettings, ...], Field(max_length=8)] = ()
    alerts: AlertSettings | None = None
    arrival_tolerance_deg: Positive = 2.0
    timeouts: Timeouts = Timeouts()
    golden: GoldenSettings | None = None
    line: LineSettings | None = None
    rehearsal: RehearsalSettings | None = None
    certificate: CertificateSettings = CertificateSettings()

    @field_validator("anchors", mode="before")
    @classmethod
    def _folders(cls, value: Any) -> Any:
        """A folder alone may be given as its path."""
        return [{"folder": v} if isinstance(v, str) else v for v in value] if isinstance(value, list) else value

    @model_validator(mode="after")
    def _witness_wants_a_key(self) -> Self:
        if self.witness and not self.signing_key:
            raise ValueError("witness: a witness takes signed heads only; name the station's key as signing_key")
        return self

    @model_validator(mode="after")
    def _receivers_differ(self) -> Self:
        names = [receiver.name for receiver in self.receivers]
        if len(set(names)) < len(names):
            raise ValueError("receivers: two have the same name; give each its own `name`")
        return self

    @model_validator(mode="after")
    def _nests_have_a_bus(self) -> Self:
        for nest in self.nests:
            if (nest.bus is not None or self.buses) and nest.bus not in self.buses:
                raise InvalidValue("nest-bus-unknown", nest=nest.name, bus=nest.bus or "", known=tuple(self.buses))
        return self

    @model_validator(mode="after")
    def _nests_differ(self) -> Self:
        by_node: dict[Any, str] = {}
        for nest in self.nests:
            if nest.node in by_node:
                raise InvalidValue("nest-node-twice", first=by_node[nest.node], second=nest.name, node=nest.node)
            if nest.name in by_node.values():
                raise InvalidValue("nest-name-twice", name=nest.name)
            by_node[nest.node] = nest.name
        return self


def config_path(path: Path | None = None) -> Path:
    """The config file: the one given, else config.yaml here, else the one shipped."""
    here = Path("config.yaml")
    return path or (here if here.is_file() else shipped_folder() / "config.yaml")


def load_config(path: Path | None = None) -> tuple[Settings, Document]:
    """Settings, and the document they come from (a positioner checks its own block of it). Errors: ConfigError."""
    document = load_document(config_path(path), ConfigError)
    return validate(document, Settings, ConfigError), document


def load_settings(path: Path | None = None) -> Settings:
    """The station's settings. Errors: ConfigError with every mistake, its line and remedy."""
    return load_config(path)[0]
