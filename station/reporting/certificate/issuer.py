"""Who issues certificates, and for whom: what no log knows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Party:
    """A laboratory or a customer. country: ISO 3166-1, two letters."""

    name: str = ""
    street: str = ""
    city: str = ""
    post_code: str = ""
    country: str = "DE"

    @property
    def address(self) -> str:
        """On one line."""
        return ", ".join(part for part in (self.street, f"{self.post_code} {self.city}".strip(), self.country) if part)


_TEXTS = ("signatory", "accreditation", "place")


@dataclass(frozen=True, slots=True)
class Issuer:
    """laboratory, customer; signatory: who answers for it; accreditation: its number, '' where there is none; place:
    where it was calibrated, in the DCC's words."""

    laboratory: Party = Party()
    customer: Party = Party()
    signatory: str = ""
    accreditation: str = ""
    place: str = "laboratory"

    @staticmethod
    def of(document: Mapping[str, Any]) -> "Issuer":
        """The issuer that a settings block describes."""
        parties = {key: Party(**document[key]) for key in ("laboratory", "customer")}
        texts = {"place": "laboratory"} | {key: document[key] for key in document if key in _TEXTS}
        return Issuer(parties["laboratory"], parties["customer"], **texts)
