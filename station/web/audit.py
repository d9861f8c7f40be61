"""The auditor's pages: find attempts, a unit's whole life, certificates, the same computed again."""

from dataclasses import asdict, replace
from typing import Any
from urllib.parse import urlencode

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from station.errors import LogError
from station.messages.labels import all_texts
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.questions import Questions
from station.ports.log_reader import Attempt, LogReader, Query
from station.reporting.certificate.document import Certificate
from station.reporting.certificate.facts import require_certifiable
from station.reporting.certificate.pdf import pdf
from station.reporting.words import Words
from station.service import evidence, time_text
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
    reasons = await run_in_threadpool(_first_reasons, panel, found[:PAGE_SIZE])
    texts = all_texts()[language.of_request(request)]
    checks = {k.removeprefix("check_"): v for k, v in sorted(texts.items()) if k.startswith("check_")}
    return render.page(
        *(request, "audit.html", session),
        checks=checks,
        questions={name: urlencode(fields) for name, fields in _questions(panel).all().items()},
        filters=shown, found=found[:PAGE_SIZE], more=more, reasons=reasons, zone=time_text.zone(),
        head=head, text=urlencode({**filters, "as": "text"}),
    )  # fmt: skip


@require_right("audit")
async def change_questions(request: Request, session: Session) -> Response:
    """Keeps the present question under a name, or forgets one."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    name, fields = str(form.get("name", "")).strip(), {k: str(form[k]).strip() for k in QUERY_FIELDS if form.get(k)}
    if form.get("forget"):
        await run_in_threadpool(_questions(panel).forget, name)
    else:
        query_of(fields)
        await run_in_threadpool(_questions(panel).save, name, fields)
    panel.journal.add(session.account.name, "question", name=name, forgotten=bool(form.get("forget")), question=fields)
    return RedirectResponse(f"/audit?{urlencode(fields)}", 303)


def _questions(panel: Panel) -> Questions:
    return Questions(companion_file(panel.order.database, Companion.QUESTIONS))


@require_right("audit")
async def show_certificate(request: Request, session: Session) -> Response:
    """The certificate of one attempt, as a page or, at `.pdf`, as a document."""
    panel: Panel = request.app.state.panel
    code = language.of_request(request)
    made = await run_in_threadpool(_certificate, panel, *_unit_and_attempt(dict(request.query_params)), code)
    panel.journal.add(session.account.name, "certificate", serial=made.serial, number=made.number)
    if not request.url.path.endswith(".pdf"):
        return render.page(request, "certificate.html", session, made=made)
    paper = await run_in_threadpool(pdf, made)
    headers = {"Content-Disposition": f'inline; filename="{file_name(made.serial)}"'}
    return Response(paper, media_type="application/pdf", headers=headers)


@require_right("audit")
async def evidence_bundle(request: Request, session: Session) -> Response:
    """One attempt's evidence as one file."""
    panel: Panel = request.app.state.panel
    serial, attempt = _unit_and_attempt(dict(request.query_params))
    words = language.words(language.of_request(request))
    made = await run_in_threadpool(_bundle, panel, serial, attempt, words)
    panel.journal.add(session.account.name, "bundle", serial=serial, attempt=attempt)
    headers = {"Content-Disposition": f'attachment; filename="{file_name(serial, "evidence", "zip")}"'}
    return Response(made, media_type="application/zip", headers=headers)


def file_name(serial: str, what: str = "certificate", ending: str = "pdf") -> str:
    """A download's name; a serial may hold what a header or a file system would take for something else."""
    return f"{what}-{''.join(c if (c.isascii() and c.isalnum()) or c in '-_' else '_' for c in serial)}.{ending}"


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


def _first_reasons(panel: Panel, found: list[Attempt]) -> dict[int, Any]:
    """Of each attempt that did not pass, by its record number: its reasons."""
    with panel.log() as log:
        return log.reasons([a.number for a in found if a.outcome in ("FAIL", "ERROR")])


def _serials(panel: Panel, query: Query) -> list[str]:
    with panel.log() as log:
        return sorted({a.serial for a in log.attempts(replace(query, before=None))})


def _attempt(log: LogReader, serial: str, attempt: str) -> Attempt:
    for found in log.attempts(Query(serial=serial)):
        if found.attempt == attempt:
            return found
    raise LogError("page-no-attempt", attempt=attempt[:40], serial=serial[:40])


def _unit_and_attempt(parameters: dict[str, str]) -> tuple[str, str]:
    return parameters.get("serial", ""), parameters.get("attempt", "")


def _certificate(panel: Panel, serial: str, attempt: str, code: str) -> Certificate:
    with panel.log() as log:
        chosen = _attempt(log, serial, attempt)
        require_certifiable(log.attempt(chosen))
        return certificate_of(log, chosen, language.words(code))


def _bundle(panel: Panel, serial: str, attempt: str, words: Words) -> bytes:
    with panel.log() as log:
        return evidence.bundle(log, _attempt(log, serial, attempt), words)


def _recompute(panel: Panel, serial: str, attempt: str) -> dict[str, Any]:
    from station.service.recompute import recompute as again

    with panel.log() as log:
        done = again(log, _attempt(log, serial, attempt))
    return done.document()


ROUTES = [
    Route("/audit", search, methods=["GET"]),
    Route("/audit/questions", change_questions, methods=["POST"]),
    Route("/audit/certificate", show_certificate, methods=["GET"]),
    Route("/audit/certificate.pdf", show_certificate, methods=["GET"]),
    Route("/audit/bundle", evidence_bundle, methods=["GET"]),
    Route("/audit/recompute", recompute, methods=["POST"]),
    Route("/journal", journal, methods=["GET"]),
]
