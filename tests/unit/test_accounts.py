"""Accounts, sessions and guesses: what the log-in stands on."""

import stat
from pathlib import Path

import pytest

from station.errors import ConfigError, UsageError
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.web import sessions


@pytest.fixture(scope="module")
def hashed() -> str:
    return accounts.hash_password("correct horse")


def test_a_password_is_kept_only_as_a_salted_hash(hashed: str) -> None:
    assert "correct horse" not in hashed
    assert hashed != accounts.hash_password("correct horse")
    assert accounts.verify_password("correct horse", hashed)
    assert not accounts.verify_password("correct horsE", hashed)
    assert not accounts.verify_password("anything", accounts.DUMMY_HASH)
    assert not accounts.verify_password("correct horse", "not a hash")


def test_a_short_password_is_refused() -> None:
    with pytest.raises(UsageError, match="8 to 200 characters"):
        accounts.hash_password("short")


def test_accounts_survive_the_file_which_only_its_owner_reads(tmp_path: Path, hashed: str) -> None:
    people = {"Zoë": Account("Zoë", Role.OPERATOR, hashed)}
    accounts.save(tmp_path / "accounts.json", people)
    assert accounts.load(tmp_path / "accounts.json") == people
    assert stat.S_IMODE((tmp_path / "accounts.json").stat().st_mode) == 0o600
    assert accounts.load(tmp_path / "none.json") == {}


@pytest.mark.parametrize("text", ["", "[]", '{"accounts": [{"name": "a"}]}', '{"accounts": 3}'])
def test_a_broken_accounts_file_is_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(
        ConfigError, match=r"not a readable list of accounts \((line 1, column \d+ is not JSON|a part of it is missing)"
    ):
        accounts.load(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("role", "rights"), [("operator", {"watch", "run"}), ("auditor", {"watch", "audit", "charts", "sign"})]
)
def test_each_role_has_its_own_rights(role: str, rights: set[str], hashed: str) -> None:
    person = Account("p", Role(role), hashed)
    assert {right for right in accounts.RIGHTS if person.may(right)} == rights


class HandClock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_session_ends_when_idle_and_in_any_case_after_a_shift() -> None:
    clock = HandClock()
    open_ = sessions.Sessions(clock, idle_s=100, longest_s=250)
    token = open_.begin(Account("p", Role.OPERATOR, "x")).token
    for clock.now_s in (90, 180, 240):
        assert open_.find(token) is not None
    clock.now_s = 251
    assert open_.find(token) is None
    other = open_.begin(Account("p", Role.OPERATOR, "x")).token
    clock.now_s += 100
    assert open_.find(other) is None
    assert open_.find(None) is None


def test_a_form_token_belongs_to_one_session() -> None:
    open_ = sessions.Sessions(HandClock())
    a, b = (open_.begin(Account("p", Role.OPERATOR, "x")) for _ in range(2))
    assert sessions.same_token(a, a.csrf)
    assert not sessions.same_token(a, b.csrf)
    assert not sessions.same_token(a, "é")
    open_.end(a.token)
    assert open_.find(a.token) is None


def test_no_name_can_be_taken_for_another() -> None:
    others = ("ada", "Li Wei", "O'Neil", "bob1")
    for alike in ("Ada", "\u0430d\u0430", "a d a", "\uff41da", "a\u0301da", "AD\u0410", "LiWei", "O\u2019Neil", "bobl"):
        with pytest.raises(UsageError, match="can be taken for"):
            accounts.check_name(alike, others)
    for other in ("ada", "adam", "bob2", "\u674e\u4f1f", "\u0418\u0432\u0430\u043d"):
        accounts.check_name(other, others)
    for none in ("", " ada", "ada ", "a\u200bda", "a\tb", "x" * 65):
        with pytest.raises(UsageError, match="1 to 64 printable"):
            accounts.check_name(none, others)


def test_guessing_is_slowed_and_a_success_forgives() -> None:
    clock = HandClock()
    guesses = sessions.LoginThrottle(clock, most=3, window_s=60)
    for clock.now_s in (0, 10, 20):
        assert not guesses.guessing("name")
        guesses.failed("name", "10.0.0.1")
    assert guesses.guessing("name")
    assert guesses.guessing("other", "10.0.0.1")
    assert not guesses.guessing("other")
    assert guesses.delay_s("other") == 0
    delays = []
    for _ in range(9):
        delays.append(guesses.delay_s("name", "10.0.0.1"))
        guesses.failed("name", "10.0.0.1")
    assert delays[:3] == [0.25, 0.5, 1.0]
    assert delays[-1] == guesses.longest_delay_s, "a guess is never answered later than that"
    clock.now_s = 81
    assert not guesses.guessing("name")
    for _ in range(3):
        guesses.failed("name")
    guesses.clear_failures("name")
    assert not guesses.guessing("name")
