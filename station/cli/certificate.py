"""`station certificate`: the calibration certificate of a unit."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import ConfigPath, LogPath


def command(
    serial: Annotated[str, Argument(help="The unit.")],
    attempt: Annotated[str | None, Option(help="Which attempt; left out: the newest that passed.")] = None,
    pdf: Annotated[Path | None, Option(help="PDF file to write.")] = None,
    xml: Annotated[Path | None, Option(help="DCC file to write (PTB Digital Calibration Certificate).")] = None,
    json: Annotated[Path | None, Option(help="JSON file to write.")] = None,
    wsjf: Annotated[Path | None, Option(help="WATS WSJF file to write.")] = None,
    dcc_version: Annotated[str, Option(help="DCC schema: 3.3.0 or 3.2.1.")] = "3.3.0",
    sign_key: Annotated[Path | None, Option(help="Private key (PEM) that signs the DCC; with --sign-cert.")] = None,
    sign_cert: Annotated[Path | None, Option(help="Certificate (PEM) of that key.")] = None,
    language: Annotated[str, Option(help="Language of the PDF: en, de or zh.")] = "en",
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Write the calibration certificate of a unit that passed: PDF, DCC XML, JSON, WSJF.

    Laboratory, customer and signatory stand in config.yaml, block `certificate`.

        station certificate SN0001 --pdf SN0001.pdf --xml SN0001.xml --json SN0001.json
    """
    from station.cli._certificate import CertificateFiles, write_certificate

    files = CertificateFiles(pdf, xml, json, wsjf, dcc_version, sign_key, sign_cert, language)
    return write_certificate(serial, attempt, files, db, config)
