"""`station certificate`: the calibration certificate of a unit."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from station.cli._options import ConfigPath, LogPath

#: Options that only go with one of these words.
GOES_WITH = {
    "--key": ("--check",), "--sign-key": ("--xml",), "--sign-cert": ("--xml",), "--dcc-version": ("--xml",),
}  # fmt: skip
#: Options that none of these words may stand beside.
APART = {"--attempt": ("--check",), "--language": ("--check",), "--changed": ("--check",)}


def command(
    serial: Annotated[str | None, Argument(help="The unit.")] = None,
    attempt: Annotated[str | None, Option(help="Which attempt; left out: the newest that passed.")] = None,
    pdf: Annotated[Path | None, Option(help="PDF file to write.")] = None,
    xml: Annotated[Path | None, Option(help="DCC file to write (PTB Digital Calibration Certificate).")] = None,
    json: Annotated[Path | None, Option(help="JSON file to write.")] = None,
    wsjf: Annotated[Path | None, Option(help="WATS WSJF file to write.")] = None,
    dcc_version: Annotated[str, Option(help="DCC schema: 3.3.0 or 3.2.1.")] = "3.3.0",
    sign_key: Annotated[Path | None, Option(help="Private key (PEM) that signs the DCC; with --sign-cert.")] = None,
    sign_cert: Annotated[Path | None, Option(help="Certificate (PEM) of that key.")] = None,
    language: Annotated[str, Option(help="Language of the PDF: en, de or zh.")] = "en",
    changed: Annotated[str, Option(help="What an amended certificate changes, where the log does not know.")] = "",
    check: Annotated[Path | None, Option(help="Compare this PDF, DCC or JSON with the log.")] = None,
    key: Annotated[Path | None, Option(help="With --check: the station's public key, PEM.")] = None,
    db: LogPath = None,
    config: ConfigPath = None,
) -> int:
    """Write the calibration certificate of a unit that passed: PDF, DCC XML, JSON, WSJF.

    Laboratory, customer and signatory stand in config.yaml, block `certificate`.

        station certificate SN0001 --pdf SN0001.pdf --xml SN0001.xml --json SN0001.json

    Is a certificate that somebody shows as the log has it:

        station certificate --check SN0042.pdf
    """
    from station.cli._certificate import CertificateFiles, write_certificate
    from station.cli._certificate_check import check_file
    from station.errors import UsageError

    files = CertificateFiles(pdf, xml, json, wsjf, dcc_version, sign_key, sign_cert, language, changed)
    if check is not None:
        if serial is not None or files.any:
            raise UsageError("certificate-check-alone")
        return check_file(check, db, config, key)
    if serial is None:
        raise UsageError("certificate-serial-missing")
    return write_certificate(serial, attempt, files, db, config)
