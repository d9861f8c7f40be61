"""Turns at one thing: each who waits in turn, none for all that another has waiting."""

import anyio
import pytest

from station.panel_protocol.accounts import Account, Role
from station.web.fair_turns import FairTurns
from station.web.known_browsers import known_browser, mark_cookie, new_mark

pytestmark = pytest.mark.anyio


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


async def test_whoever_comes_late_waits_for_one_turn_of_each_other() -> None:
    turns, had, begun = FairTurns(most_waiting=5), list[str](), anyio.Event()

    async def come(who: str) -> None:
        async with turns.turn(who):
            had.append(who)
            await begun.wait()

    async with anyio.create_task_group() as group:
        for who in ("a", "a", "a", "a", "b", "b", "c"):
            group.start_soon(come, who)
            await anyio.wait_all_tasks_blocked()
        assert (turns.full("a"), turns.full("b")) == (False, False)
        begun.set()
    assert had == ["a", "a", "b", "c", "a", "b", "a"]


async def test_so_many_of_one_may_wait_and_whoever_leaves_makes_room() -> None:
    turns, end = FairTurns(most_waiting=2), anyio.Event()

    async def hold() -> None:
        async with turns.turn("a"):
            await end.wait()

    async def wait(scope: anyio.CancelScope) -> None:
        with scope:
            async with turns.turn("a"):
                pass

    async with anyio.create_task_group() as group:
        group.start_soon(hold)
        scopes = [anyio.CancelScope(), anyio.CancelScope()]
        for scope in scopes:
            await anyio.wait_all_tasks_blocked()
            assert not turns.full("a")
            group.start_soon(wait, scope)
        await anyio.wait_all_tasks_blocked()
        assert turns.full("a")
        assert not turns.full("b")
        scopes[0].cancel()
        await anyio.wait_all_tasks_blocked()
        assert not turns.full("a")
        end.set()
    async with turns.turn("b"):
        assert not turns.full("b")


async def test_one_whose_turn_came_as_it_left_passes_it_on() -> None:
    turns, had = FairTurns(), list[str]()
    scope = anyio.CancelScope()

    async def leave() -> None:
        with scope:
            async with turns.turn("a"):
                had.append("left")

    async def come() -> None:
        async with turns.turn("b"):
            had.append("came")

    async with anyio.create_task_group() as group, turns.turn("first"):
        group.start_soon(leave)
        await anyio.wait_all_tasks_blocked()
        group.start_soon(come)
        await anyio.wait_all_tasks_blocked()
        scope.cancel()
    assert had == ["came"]


def test_a_browser_is_known_to_the_person_who_logged_in_there_until_the_password_changes() -> None:
    anna, otto = Account("anna", Role.OPERATOR, "scrypt$1"), Account("otto", Role.OPERATOR, "scrypt$2")
    cookies = {mark_cookie(person.name): new_mark(person) for person in (anna, otto)}
    assert len(cookies) == 2
    assert known_browser(cookies, anna) != known_browser(cookies, otto) != ""
    for name, person in (("anna", Account("anna", Role.OPERATOR, "scrypt$3")), ("nobody", None)):
        assert known_browser(cookies, person) == "", name
    for forged in ("", ".", "00.", f"{'0' * 32}.{'0' * 64}", "é.é", cookies[mark_cookie("otto")]):
        assert known_browser({mark_cookie("anna"): forged}, anna) == ""
