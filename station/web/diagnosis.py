"""The engineer's diagnoses: of units, a load, a day or a nest; what changed since last week; the reports."""

from dataclasses import replace

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from station.errors import UsageError
from station.reporting.line.week_change import WeekChange, week_change
from station.service.line_statistics import attempt_values
from station.service.time_text import parse_ns
from station.web import diagnosis_jobs, language, render
from station.web.guard import form_of, require_right
from station.web.panel import Panel
from station.web.query_form import query_of
from station.web.sessions import Session

#: What a diagnosis may be of, beside picked units.
SCOPE_FIELDS = ("serial", "since", "until", "station", "nest", "recipe_name")
#: Of each week so many of the newest attempts are compared.
MOST_COMPARED = 500
#: The report is one page with its style and figures in it, and no script; only our own page may frame it.
_REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; sandbox"
_FRAMING_POLICY = (
    "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'self'; script-src 'self'; "
    "frame-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)


@require_right("diagnose")
async def begin(request: Request, session: Session) -> Response:
    """Starts the diagnosis of the units picked, or of all that the fields name."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    serials = sorted({str(s) for s in form.getlist("serial") if s})
    question = {k: str(form.get(k) or "") for k in SCOPE_FIELDS[1:] if form.get(k)}
    if any(set(serial) & set("*?") for serial in serials):
        question, serials = question | {"serial": serials[0]}, []
    if len(serials) > diagnosis_jobs.MOST_UNITS or not (serials or question):
        raise UsageError("diagnosis-pick-units", limit=diagnosis_jobs.MOST_UNITS)
    query = query_of(question)
    name = await run_in_threadpool(
        diagnosis_jobs.start_diagnosis,
        panel,
        session.account.name,
        serials,
        {"serial": ", ".join(serials)} | question,
        query,
    )
    panel.journal.add(session.account.name, "diagnose", serials=serials or question, report=name)
    return RedirectResponse(f"/diagnosis?name={name}", 303)


@require_right("diagnose")
async def show(request: Request, session: Session) -> Response:
    """One diagnosis: how far it is, what went wrong, or its report; without a name: the form, and all before."""
    panel: Panel = request.app.state.panel
    name = request.query_params.get("name")
    if name is None:
        filters = {k: request.query_params.get(k, "")[:80] for k in SCOPE_FIELDS}
        before = await run_in_threadpool(diagnosis_jobs.earlier_diagnoses, panel)
        return render.page(request, "diagnoses.html", session, filters=filters, before=before)
    found = await run_in_threadpool(diagnosis_jobs.diagnosis_state, panel, name)
    answer = render.page(request, "diagnosis.html", session, one=found)
    answer.headers["Content-Security-Policy"] = _FRAMING_POLICY
    return answer


@require_right("diagnose")
async def show_report(request: Request, _session: Session) -> Response:
    """The report alone, to be framed or printed."""
    folder = diagnosis_jobs.diagnosis_folder(request.app.state.panel, request.query_params.get("name", ""))
    if not (folder / "report.html").exists():
        raise UsageError("diagnosis-unknown")
    headers = {"Content-Security-Policy": _REPORT_POLICY, "X-Frame-Options": "SAMEORIGIN"}
    look = render.theme_of(request) or "auto"
    report = (folder / "report.html").read_bytes().replace(b"<html ", f'<html class="{look}" '.encode(), 1)
    return HTMLResponse(report, headers=headers)


@require_right("diagnose")
async def show_changes(request: Request, session: Session) -> Response:
    """The last seven days against the seven before."""
    panel: Panel = request.app.state.panel
    found = await run_in_threadpool(_week_change, panel)
    words = language.words(language.of_request(request))
    return render.page(request, "changes.html", session, found=found, lines=[words.render(m) for m in found.messages])


def _week_change(panel: Panel) -> WeekChange:
    filters = dict.fromkeys(SCOPE_FIELDS, "")
    now_ns, week_ns = parse_ns("0d", end=False), parse_ns("0d", end=False) - parse_ns("7d", end=False)
    base = query_of(filters)
    weeks = (
        replace(base, since_ns=now_ns - 2 * week_ns, until_ns=now_ns - week_ns),
        replace(base, since_ns=now_ns - week_ns),
    )
    with panel.log() as log:
        rows = [log.attempts(week, MOST_COMPARED) for week in weeks]
        values = [attempt_values(log, week, MOST_COMPARED) for week in weeks]
    return week_change((rows[0], values[0]), (rows[1], values[1]))


ROUTES = [
    Route("/diagnose", begin, methods=["POST"]),
    Route("/diagnosis", show, methods=["GET"]),
    Route("/diagnosis/report", show_report, methods=["GET"]),
    Route("/diagnosis/changes", show_changes, methods=["GET"]),
]
