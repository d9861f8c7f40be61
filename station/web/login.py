"""Log-in and log-out: guessing is slowed, the same time for known and unknown names, every try in the journal.

A guesser's tries are checked one at a time, addresses in turns. Only so many of one address wait; what comes beyond is
turned away late and unchecked. A browser in which the person has logged in before is counted by itself: whatever others
guess, and from wherever, the right password opens there at once.
"""

from functools import partial
from typing import NoReturn

from anyio import sleep, to_thread
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from station.errors import UsageError
from station.messages import Message
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account
from station.web import render
from station.web.guard import SESSION_COOKIE, RequestRefusal, form_of, require_right, session_of
from station.web.known_browsers import LASTS_S, known_browser, mark_cookie, new_mark
from station.web.panel import Panel
from station.web.sessions import Session

#: Of so many tries that are turned away unchecked, the first is a line of the journal.
_JOURNAL_EVERY = 100


async def show(request: Request) -> Response:
    """The form."""
    if session_of(request) is not None:
        return RedirectResponse("/", 303)
    return render.page(request, "login.html", None, error="")


async def log_in(request: Request) -> Response:
    """Checks name and password; a cookie that no script reads, or the form again with the reason."""
    panel: Panel = request.app.state.panel
    form = await form_of(request, None)
    account = await person_of(request, str(form.get("name", "")), str(form.get("password", "")), "log-in-refused")
    if account is None:
        return render.page(request, "login.html", None, 401, error="wrong_password")
    await to_thread.run_sync(partial(panel.journal.add, account.name, "log-in", role=str(account.role)))
    inside = RedirectResponse("/", 303)
    panel.sessions.end(request.cookies.get(SESSION_COOKIE, ""))  # whoever was logged in here before is no more
    token = panel.sessions.begin(account).token
    inside.set_cookie(SESSION_COOKIE, token, httponly=True, samesite="strict", secure=panel.secure, path="/")
    inside.set_cookie(
        mark_cookie(account.name),
        new_mark(account),
        max_age=LASTS_S,
        httponly=True,
        samesite="strict",
        secure=panel.secure,
        path="/",
    )
    return inside


async def person_of(request: Request, name: str, password: str, refusal: str) -> Account | None:
    """Whose name and password these are; None, after a while, where they are nobody's. refusal: how the journal calls
    that. Errors: UsageError where the account is not the one that the log has sealed; RequestRefusal where too many
    tries of this address wait already."""
    panel: Panel = request.app.state.panel
    name, password = name[: accounts.MAX_LENGTH], password[: accounts.MAX_LENGTH]
    account = panel.people.get(name)
    address = request.client.host if request.client else ""
    browser = known_browser(request.cookies, account)
    keys = (f"browser {browser}",) if browser else (f"name {name}", f"address {address}")
    guessing = panel.login_throttle.guessing(*keys)
    turns, who = panel.guesser_turns if guessing else panel.password_turns, browser or address
    if turns.full(who):
        await _turn_away(panel, name)
    # Counted before it is known: tries that come at the same time all count.
    panel.login_throttle.failed(*keys)
    stored_hash = account.password if account else accounts.DUMMY_HASH
    async with turns.turn(who):
        right = await to_thread.run_sync(accounts.verify_password, password, stored_hash, limiter=panel.hashing)
    if account is None or not right:
        await to_thread.run_sync(panel.journal.add, name, refusal)
        await sleep(panel.login_throttle.delay_s(*keys))
        return None
    panel.login_throttle.clear_failures(*keys)
    try:
        await to_thread.run_sync(panel.check_sealed, account)
    except UsageError:
        await to_thread.run_sync(panel.journal.add, name, "account-not-sealed")
        raise
    return account


async def _turn_away(panel: Panel, name: str) -> NoReturn:
    """Answers late that too many wait. Errors: RequestRefusal, always."""
    panel.turned_away += 1
    if panel.turned_away % _JOURNAL_EVERY == 1:
        await to_thread.run_sync(partial(panel.journal.add, name, "log-in-turned-away", count=panel.turned_away))
    await sleep(panel.login_throttle.longest_delay_s)
    raise RequestRefusal(429, Message("log-in-crowded"))


@require_right("watch")
async def log_out(request: Request, session: Session) -> Response:
    """Ends the session here and in the browser."""
    await form_of(request, session)
    panel: Panel = request.app.state.panel
    panel.sessions.end(session.token)
    await to_thread.run_sync(panel.journal.add, session.account.name, "log-out")
    answer = RedirectResponse("/login", 303)
    answer.delete_cookie(SESSION_COOKIE, path="/")
    return answer


ROUTES = [
    Route("/login", show, methods=["GET"]),
    Route("/login", log_in, methods=["POST"]),
    Route("/logout", log_out, methods=["POST"]),
]
