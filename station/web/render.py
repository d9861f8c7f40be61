"""Templates → answers: HTML with everything escaped, in the person's language, with their rights and their token."""

from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse

from station.adapters.store.life import utc
from station.web import language
from station.web.accounts import RIGHTS
from station.web.sessions import Session

_FOLDER = Path(__file__).parent / "templates"
SYMBOLS = {"PASS": "✔", "FAIL": "✘", "ERROR": "⚠", "ABORTED": "■", "INTERRUPTED": "⏸"}


@lru_cache(maxsize=1)
def environment() -> Environment:
    """The templates; a name that is not there is an error, not an empty place."""
    made = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    made.filters |= {"utc": utc, "number": number, "drawing": Markup}
    made.globals["symbols"] = SYMBOLS
    return made


def number(value: Any, digits: int = 6) -> str:
    """A figure for a person: short, with a real minus; '–' where there is none."""
    return "–" if value is None else f"{value:.{digits}g}".replace("-", "−")


def page(request: Request, name: str, session: Session | None, status: int = 200, **values: Any) -> HTMLResponse:
    """One page. values: what its template shows."""
    code = language.of_request(request)
    texts = language.all_texts()[code]
    account = session.account if session else None
    html = (
        environment()
        .get_template(name)
        .render(
            t=texts,
            language=code,
            languages={known: texts["language_name"] for known, texts in language.all_texts().items()},
            query=urlencode([(k, v) for k, v in request.query_params.multi_items() if k != "language"]),
            station=request.app.state.panel.settings.station,
            path=request.url.path,
            person=account.name if account else "",
            role=str(account.role) if account else "",
            may={right: bool(account and account.may(right)) for right in RIGHTS},
            csrf=session.csrf if session else "",
            **values,
        )
    )
    answer = HTMLResponse(html, status)
    if request.query_params.get("language") == code:
        answer.set_cookie(language.COOKIE, code, max_age=365 * 86400, samesite="strict")
    return answer
