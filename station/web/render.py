"""Templates → answers: HTML with everything escaped, in the person's language, with their rights and their token."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from jinja2 import Environment, FileSystemLoader, StrictUndefined, pass_context
from jinja2.runtime import Context
from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from station.domain.records.stored_attempt import utc
from station.messages import Message, labels, term
from station.panel_protocol.accounts import RIGHTS
from station.reporting.drawing.drawing import Drawing
from station.reporting.number_text import format_number, format_time, format_to_uncertainty
from station.service import time_text
from station.web import language
from station.web.sessions import Session
from station.web.static_files import static_address

_FOLDER = Path(__file__).parent / "templates"
THEME_COOKIE, THEMES = "station_theme", ("light", "dark", "hc")
SYMBOLS = {"PASS": "✔", "FAIL": "✘", "ERROR": "⚠", "ABORTED": "■", "INTERRUPTED": "⏸"}


@lru_cache(maxsize=1)
def environment() -> Environment:
    """The templates; a name that is not there is an error, not an empty place."""
    made = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    made.filters |= {
        "utc": utc,
        "number": format_number,
        "drawing": _drawing,
        "term": _term,
        "sentence": _sentence,
        "quoted": format_to_uncertainty,
        "moment": format_time,
        "local": time_text.local,
        "local_short": time_text.local_short,
    }
    made.globals |= {"symbols": SYMBOLS, "static": static_address}
    return made


def _drawing(drawing: Drawing | str) -> Markup:
    """Both widths: the page's style shows the one that the window has room for. Who draws escapes every text."""
    if isinstance(drawing, str):
        return Markup(drawing)
    return Markup(f'<div class="wide-only">{drawing}</div><div class="narrow-only">{drawing.narrow()}</div>')


@pass_context
def _term(context: Context, name: str) -> str:
    """The name of a quantity in the page's language."""
    return term(name, str(context["language"]))


@pass_context
def _sentence(context: Context, recorded: Mapping[str, Any] | str) -> str:
    """A recorded reason or message in the page's language; an older log's sentence as it stands there."""
    if isinstance(recorded, Mapping) and "id" not in recorded:
        recorded = Message.recorded(recorded).document()
    return language.sentence(recorded, str(context["language"]))


def page(request: Request, name: str, session: Session | None, status: int = 200, **values: Any) -> HTMLResponse:
    """One page. values: what its template shows."""
    code = language.of_request(request)
    texts = labels.all_texts()[code]
    account = session.account if session else None
    panel = request.app.state.panel
    html = (
        environment()
        .get_template(name)
        .render(
            t=texts,
            language=code,
            languages={known: texts["language_name"] for known, texts in labels.all_texts().items()},
            query=urlencode([(k, v) for k, v in request.query_params.multi_items() if k != "language"]),
            station=panel.settings.station,
            plant=panel.plant,
            # Only a path of ours: of any other the browser might make an address of somebody else's.
            path=request.url.path if "endpoint" in request.scope else "/",
            person=account.name if account else "",
            role=str(account.role) if account else "",
            may={right: bool(account and account.may(right) and panel.offers(right)) for right in RIGHTS},
            csrf=session.csrf if session else "",
            theme=theme_of(request),
            themes=("auto", *THEMES),
            **values,
        )
    )
    answer = HTMLResponse(html, status)
    remember_choice(request, answer)
    return answer


def remember_choice(request: Request, answer: Response) -> Response:
    """The answer, with the language and the appearance that the address names as cookies."""
    code = language.of_request(request)
    if request.query_params.get("language") == code:
        answer.set_cookie(language.LANGUAGE_COOKIE, code, max_age=365 * 86400, samesite="strict")
    if "theme" in request.query_params:
        answer.set_cookie(THEME_COOKIE, theme_of(request), max_age=365 * 86400, samesite="strict")
    return answer


def theme_of(request: Request) -> str:
    """The appearance that was chosen by link and is remembered by cookie; '' is that of the reader's system."""
    wished = request.query_params.get("theme", request.cookies.get(THEME_COOKIE, ""))
    return wished if wished in THEMES else ""
