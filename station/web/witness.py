"""The witness over HTTP: `GET /heads/STATION` gives the newest head, `POST /heads` takes the next one or refuses it."""

from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from station.domain.records.tree_head import TreeHead
from station.errors import StationError
from station.files.json_text import parse_json
from station.service.witness import Refusal, Replacement, Witness
from station.web.connections import GONE, ErrorHandlers, GuardedConnection, allow_connections

#: A proof over 2⁶⁴ records is shorter.
_MOST_BYTES, _MOST_STEPS = 65_536, 128
_LONGEST_END = 200


async def _not_now(_: Request, exc: Exception) -> Response:
    """The station tries again: nothing that came is lost, it is still in its log."""
    assert isinstance(exc, StationError)
    return JSONResponse({"error": exc.sentence, "message": exc.message.document()}, 503, {"retry-after": "5"})


#: What an application that stations talk to answers where it cannot do its work.
ERRORS: ErrorHandlers = {StationError: _not_now, **GONE}


def witness_connections() -> dict[str, Any]:
    """What uvicorn is told of connections; this process may hold many from now on."""
    allow_connections()
    return {"http": GuardedConnection, "ws": "none"}


def create_witness_app(witness: Witness) -> Starlette:
    """The application of a witness."""

    async def newest(request: Request) -> Response:
        head = witness.newest(request.path_params["station"])
        return JSONResponse({"head": head.document() if head else None})

    async def submit(request: Request) -> Response:
        try:
            head, earlier, proof, replaces = _submission(await _body(request))
        except (ValueError, KeyError, TypeError, RecursionError):
            return JSONResponse({"refused": "no-tree-head"}, 400)
        answer = await run_in_threadpool(witness.submit, head, earlier, proof, replaces=replaces)
        if isinstance(answer, Refusal):
            return JSONResponse({"refused": str(answer)}, 409)
        return JSONResponse({"at_ns": answer.at_ns, "signature": answer.signature.hex()})

    return Starlette(
        routes=[Route("/heads/{station}", newest), Route("/heads", submit, methods=["POST"])], exception_handlers=ERRORS
    )


async def _body(request: Request) -> bytes:
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > _MOST_BYTES:
            raise ValueError("too long")
    return data


def _submission(data: bytes) -> tuple[TreeHead, int, list[bytes], Replacement]:
    document: dict[str, Any] = parse_json(data)
    proof = [bytes.fromhex(step) for step in document["proof"]]
    if len(proof) > _MOST_STEPS or any(len(step) != 32 for step in proof):
        raise ValueError("no proof")
    replaces = Replacement(str(document.get("replaces", "")), str(document.get("replaces_signature", "")))
    if len(replaces.end) > _LONGEST_END or bytes.fromhex(replaces.signature) is None:
        raise ValueError("no end of a log")
    return TreeHead.of(document["head"]), int(document["earlier"]), proof, replaces
