"""The auditor's pages: find attempts, a unit's whole life, certificates, the same computed again."""

from dataclasses import asdict, replace
from typing import Any
from urllib.parse import urlencode

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from station.domain.methods import coefficients
from station.domain.records.stored_attempt import result
from station.errors import LogError
from station.messages import Message
from station.ports.log_reader import Attempt, LogReader, Query
from station.reporting.certificate.document import Certificate
from station.reporting.certificate.pdf import pdf
from station.reporting.drawing.figure import Figure, Series, svg
from station.reporting.words import term
from station.service.certificates import certificate_of
from station.web import language, render
from station.web.guard import form_of, require_right
from station.web.panel import Panel
from station.web.query_form import QUERY_FIELDS, query_of
from station.web.sessions import Session

#: Attempts on one page; the next page begins where this one ends.
PAGE_SIZE = 100


@require_right("audit")
async def search(request: Request, session: Session) -> Response:
    """The form and what it found; `as=text` gives every serial, one a line: the list of a recall."""
    panel: Panel = request.app.state.panel
    parameters = dict(request.query_params)
    query = query_of(parameters)
    filters = {k: v[:200] for k, v in parameters.items() if k in QUERY_FIELDS and v}
    if parameters.get("as") == "text":
        serials = await run_in_threadpool(_serials, panel, query)
        panel.journal.add(session.account.name, "containment", question=filters, units=len(serials))
        return PlainTextResponse("".join(f"{s}\n" for s in serials))
    found, head = await run_in_threadpool(_matching_attempts, panel, query)
    more = urlencode({**filters, "before": found[PAGE_SIZE - 1].number}) if len(found) > PAGE_SIZE else ""
    shown = {k: parameters.get(k, "") for k in QUERY_FIELDS}
    return render.page(
        *(request, "audit.html", session),
        asked=shown, found=found[:PAGE_SIZE], more=more, head=head, text=urlencode({**filters, "as": "text"}),
    )  # fmt: skip


@require_right("audit")
async def unit(request: Request, session: Session) -> Response:
    """Everything ever done to one serial."""
    panel: Panel = request.app.state.panel
    serial, code = request.query_params.get("serial", ""), language.of_request(request)
    lives = await run_in_threadpool(_unit_history, panel, serial)
    history = [(a, result(a, "calibration")) for a in lives]
    history = [(a, fit) for a, fit in history if fit and fit.get("offset") is not None]
    rows = [
        (
            name,
            [_theta(fit)[i] for _, fit in history],
            [b["expanded"] for b in (fit["budget"][i] for _, fit in history)],
        )
        for i, name in enumerate(coefficients.NAMES)
    ]
    return render.page(
        *(request, "unit.html", session),
        serial=serial, lives=lives[::-1], history=[a for a, _ in history], rows=rows, chart=_chart(history, code),
        certified={a["attempt"] for a, _ in history},
    )  # fmt: skip


@require_right("audit")
async def show_certificate(request: Request, session: Session) -> Response:
    """The certificate of one attempt, as a page or, at `.pdf`, as a document."""
    panel: Panel = request.app.state.panel
    code = language.of_request(request)
    made = await run_in_threadpool(_certificate, panel, *_unit_and_attempt(dict(request.query_params)), code)
    panel.journal.add(session.account.name, "certificate", serial=made.serial, attempt=made.attempt)
    if not request.url.path.endswith(".pdf"):
        return render.page(request, "certificate.html", session, made=made)
    paper = await run_in_threadpool(pdf, made)
    headers = {"Content-Disposition": f'inline; filename="{file_name(made.serial)}"'}
    return Response(paper, media_type="application/pdf", headers=headers)


def file_name(serial: str) -> str:
    """A certificate's file; a serial may hold what a header or a file system would take for something else."""
    return f"certificate-{''.join(c if (c.isascii() and c.isalnum()) or c in '-_' else '_' for c in serial)}.pdf"


@require_right("audit")
async def recompute(request: Request, session: Session) -> Response:
    """Refits one attempt from its raw frames, and says whether every bit comes out again."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    which = _unit_and_attempt({k: str(v) for k, v in form.items()})
    done = await run_in_threadpool(_recompute, panel, *which)
    panel.journal.add(
        session.account.name, "recompute", serial=which[0], attempt=which[1], differences=done["differences"]
    )
    return render.page(request, "recomputed.html", session, done=done)


@require_right("audit")
async def journal(request: Request, session: Session) -> Response:
    """What people did at this page, newest first; an edited journal says where."""
    panel: Panel = request.app.state.panel
    lines = await run_in_threadpool(lambda: list(panel.journal.lines()))
    return render.page(request, "journal.html", session, lines=lines[::-1][:500])


def _matching_attempts(panel: Panel, query: Query) -> tuple[list[Attempt], dict[str, Any]]:
    with panel.log() as log:
        return log.attempts(query, PAGE_SIZE + 1), asdict(log.head())


def _serials(panel: Panel, query: Query) -> list[str]:
    with panel.log() as log:
        return sorted({a.serial for a in log.attempts(replace(query, before=None))})


def _unit_history(panel: Panel, serial: str) -> list[dict[str, Any]]:
    with panel.log() as log:
        found = log.life(Query(serial=serial))
    if not found:
        raise LogError("page-no-unit", serial=serial[:40])
    return found


def _attempt(log: LogReader, serial: str, attempt: str) -> Attempt:
    for found in log.attempts(Query(serial=serial)):
        if found.attempt == attempt:
            return found
    raise LogError("page-no-attempt", attempt=attempt[:40], serial=serial[:40])


def _unit_and_attempt(parameters: dict[str, str]) -> tuple[str, str]:
    return parameters.get("serial", ""), parameters.get("attempt", "")


def _certificate(panel: Panel, serial: str, attempt: str, code: str) -> Certificate:
    with panel.log() as log:
        return certificate_of(log, _attempt(log, serial, attempt), language.words(code))


def _recompute(panel: Panel, serial: str, attempt: str) -> dict[str, Any]:
    from station.service.recompute import recompute as again

    with panel.log() as log:
        done = again(log, _attempt(log, serial, attempt))
    return {**asdict(done), "identical": done.identical}


def _theta(fit: dict[str, Any]) -> list[float]:
    return [*fit["offset"], *(v for row in fit["matrix"] for v in row)]


def _chart(history: list[tuple[dict[str, Any], dict[str, Any]]], code: str) -> str:
    """The offsets from attempt to attempt with their expanded uncertainty; '' for a single one."""
    if len(history) < 2:
        return ""
    names = tuple(a["started"][:16].replace("T", " ") for a, _ in history)
    x = [float(i) for i in range(len(history))]
    series = []
    for axis in range(3):
        y = [_theta(fit)[axis] for _, fit in history]
        u = [fit["budget"][axis]["expanded"] for _, fit in history]
        low, high = [a - b for a, b in zip(y, u, strict=True)], [a + b for a, b in zip(y, u, strict=True)]
        series.append(Series(x, y, term(coefficients.NAMES[axis], code), "dots", low, high, axis))
    unit = history[0][1]["budget"][0]["unit"]
    title = language.sentence(Message("offsets-of-attempts"), code)
    return svg(Figure(title, "", unit, tuple(series), names))


ROUTES = [
    Route("/audit", search, methods=["GET"]),
    Route("/audit/unit", unit, methods=["GET"]),
    Route("/audit/certificate", show_certificate, methods=["GET"]),
    Route("/audit/certificate.pdf", show_certificate, methods=["GET"]),
    Route("/audit/recompute", recompute, methods=["POST"]),
    Route("/journal", journal, methods=["GET"]),
]
