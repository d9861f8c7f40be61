"""`station witness`: keeps signed heads of many logs and refuses a fork."""

from pathlib import Path
from typing import Annotated

from typer import Option


def command(
    key: Annotated[Path, Option(help="The witness' own private key, PEM (Ed25519).")],
    heads: Annotated[Path, Option(help="File of the heads, append-only; made where there is none.")] = Path(
        "heads.jsonl"
    ),
    station: Annotated[
        list[str] | None, Option(help="NAME=KEY.pub: serve this station; repeatable. Left out: whoever comes first.")
    ] = None,
    host: Annotated[str, Option(help="Address to listen at; only this machine unless told otherwise.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="Port to listen at; 0: any free one.")] = 8090,
) -> int:
    """Keep the heads of many stations' logs, on a machine that is none of theirs, and refuse a fork.

    A station shows its log's head after each load, with a proof that the log known so far is its beginning (RFC 9162).
    Its key once, then the witness:

        openssl genpkey -algorithm ed25519 -out witness.key
        station witness --key witness.key --heads heads.jsonl --station bench-1=station.pub

    In the station's config.yaml: `witness: {url: "http://HOST:8090", public_key: witness.pub}`.
    """
    from station.cli._witness import serve_witness

    return serve_witness(key, heads, station or [], host, port)
