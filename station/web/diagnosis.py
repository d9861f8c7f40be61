"""The diagnosis of a selection of units: their samples out of the log, `station diagnose` as a child, its report."""

import secrets
import subprocess
import sys
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from station.errors import LogError, UsageError
from station.panel_protocol.companion import Companion, companion_file
from station.ports.log_reader import Attempt, Query
from station.service import stored_attempts
from station.web import render
from station.web.guard import form_of, require_right
from station.web.panel import Panel
from station.web.sessions import Session
from station.wiring.sample_files import join, write_samples

#: So many units at most in one selection.
MOST_UNITS = 200
#: So many diagnoses at a time: each keeps a core busy, and the station works beside it.
MOST_PARALLEL = 1
#: The report is one page with its style and figures in it, and no script.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; sandbox"


@require_right("diagnose")
async def begin(request: Request, session: Session) -> Response:
    """Starts the diagnosis of the serials picked."""
    form = await form_of(request, session)
    panel: Panel = request.app.state.panel
    serials = sorted({str(s) for s in form.getlist("serial")})
    if not 0 < len(serials) <= MOST_UNITS:
        raise UsageError("diagnosis-pick-units", limit=MOST_UNITS)
    if sum(child.poll() is None for child in panel.children.values()) >= MOST_PARALLEL:
        raise UsageError("diagnosis-under-way")
    name = secrets.token_hex(8)
    panel.journal.add(session.account.name, "diagnose", serials=serials, report=name)
    await run_in_threadpool(_start_diagnosis, panel, serials, name)
    return RedirectResponse(f"/diagnosis?name={name}", 303)


@require_right("diagnose")
async def show(request: Request, session: Session) -> Response:
    """The report, when it is there; until then a page that looks again, or what went wrong."""
    panel: Panel = request.app.state.panel
    name = request.query_params.get("name", "")
    folder = _folder(panel, name)
    report, output = folder / "report.html", folder / "said.txt"
    if report.exists():
        return HTMLResponse(report.read_bytes(), headers={"Content-Security-Policy": _POLICY})
    child = panel.children.get(name)
    working = child is not None and child.poll() is None
    words = "" if working else output.read_text(encoding="utf-8", errors="replace")[-500:]
    return render.page(request, "diagnosis.html", session, working=working, words=words)


def _start_diagnosis(panel: Panel, serials: list[str], name: str) -> None:
    """Writes the samples of the newest recipe's attempts, and starts the child. Errors: LogError."""
    with panel.log() as log:
        found = [a for serial in serials for a in log.attempts(Query(serial=serial))]
        attempts = _of_one_recipe(found)
        tables = list(stored_attempts.samples(log, attempts))
        recipe_json = log.recipe_and_product(attempts[-1])[0] if attempts else ""
    if not tables:
        raise LogError("diagnosis-no-visits")
    folder = companion_file(panel.order.database, Companion.DIAGNOSES) / name
    folder.mkdir(parents=True)
    (folder / "recipe.yaml").write_text(recipe_json, encoding="utf-8")  # JSON is YAML
    write_samples(join(tables), folder / "samples.parquet")
    words = ["diagnose", "--samples", "samples.parquet", "--recipe", "./recipe.yaml", "--report", "report.html"]
    with (folder / "said.txt").open("wb") as output:
        panel.children[name] = subprocess.Popen(
            [sys.executable, "-P", "-m", "station", *words, "--json", "diagnosis.json"],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
        )  # fmt: skip


def _of_one_recipe(found: list[Attempt]) -> list[Attempt]:
    """The attempts with the newest one's recipe, oldest first: a diagnosis is of one recipe."""
    in_order = sorted(found, key=lambda a: a.started_ns)
    return [a for a in in_order if a.recipe_hash == in_order[-1].recipe_hash]


def _folder(panel: Panel, name: str) -> Path:
    folder = companion_file(panel.order.database, Companion.DIAGNOSES) / name
    if len(name) != 16 or set(name) - set("0123456789abcdef") or not folder.is_dir():
        raise UsageError("diagnosis-unknown")
    return folder


ROUTES = [Route("/diagnose", begin, methods=["POST"]), Route("/diagnosis", show, methods=["GET"])]
