"""The face of the page: people in and out, then a server until it is stopped."""

import getpass
import secrets
import socket
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from station.cli import _output
from station.config.settings import Settings, load_settings
from station.errors import ConfigError, StationFault, StoreFault, UsageError
from station.messages import Message, render, system_reason
from station.panel_protocol import accounts
from station.panel_protocol.account_seal import AccountChange, check_sealed
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.presence import serving
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.accounts import change_account, known_seal
from station.wiring.alerts import watching_in_background
from station.wiring.jobs import load_job
from station.wiring.logs import check_is_log, open_log, plant_address
from station.wiring.nest_listener import listening_in_background
from station.wiring.page_seals import sealing_in_background
from station.wiring.rehearsal import is_rehearsal
from station.wiring.run_order import RunOrder
from station.wiring.shipping import shipping_in_background

#: Of a password for a script that gave none; it is shown once, when it is in force.
_MADE_BYTES = 9


@dataclass(frozen=True, slots=True)
class PanelFiles:
    """What the command line says about files; None: as config.yaml says, or beside the log."""

    recipe: str | None
    config: Path | None
    db: Path | None
    accounts: Path | None

    def plant(self, settings: Settings) -> str:
        """The address of a plant whose page it is; "" for a station's."""
        return plant_address(self.db or Path(settings.database))

    def database(self, settings: Settings) -> Path:
        """The log; of a plant, what the page's own files are named after, in the folder where it runs."""
        return Path("plant-page") if self.plant(settings) else self.db or Path(settings.database)

    def people(self, settings: Settings) -> Path:
        """The file of the people."""
        return self.accounts or self.database(settings).parent / "accounts.json"


@dataclass(frozen=True, slots=True)
class ListenAddress:
    """Where the server listens. names: further names of this machine; proxy: the address of the proxy in front, whose
    headers name the client."""

    host: str
    port: int
    secure: bool
    names: tuple[str, ...] = ()
    proxy: str | None = None

    @property
    def host_names(self) -> frozenset[str]:
        """The names by which the page may be reached, beside any address."""
        own = ("localhost", socket.gethostname(), socket.getfqdn(), self.host, *self.names)
        return frozenset(name.lower() for name in own)


@dataclass(frozen=True, slots=True)
class PersonChange:
    """Who is added or removed, in what role, and who vouches for it."""

    add: str | None
    remove: str | None
    role: str
    by: str | None


def change_accounts(where: PanelFiles, wish: PersonChange) -> int:
    """Adds or removes one person, and seals that into the log.

    Errors: UsageError, ConfigError, LogError, StoreFault.
    """
    settings = load_settings(where.config)
    path, database = where.people(settings), where.database(settings)
    people = accounts.load(path)
    if wish.remove is not None and wish.remove not in people:
        raise UsageError("panel-no-person", file=str(path), name=wish.remove, people=tuple(people))
    if wish.add is not None:
        accounts.check_name(wish.add, people)
        if wish.role not in list(Role):
            raise UsageError("panel-unknown-role", role=wish.role, roles=tuple(Role))
    if wish.by is not None:
        _check_voucher(wish, path, people, database)
    made = ""
    for name in (n for n in (wish.remove, wish.add) if n is not None):
        account = None
        if name == wish.add:
            given = _read_password(name)
            made = "" if given else secrets.token_urlsafe(_MADE_BYTES)
            account = Account(name, Role(wish.role), accounts.hash_password(given or made))
        if not change_account(database, settings, path, AccountChange(name, account, wish.by or "")):
            _output.print_remark(render(Message("account-unsealed", name=name)))
    if made:
        _output.print_line(render(Message("password-made", name=str(wish.add), password=made)))
    shown = ", ".join(f"{p.name} ({p.role})" for p in accounts.load(path).values())
    _output.print_line(f"{path}: {shown or 'nobody'}")
    return 0


def _check_voucher(wish: PersonChange, file: Path, people: Mapping[str, Account], database: Path) -> None:
    """An engineer vouches for any change, everybody for a new password of their own. Errors: UsageError."""
    who = people.get(str(wish.by))
    if who is None:
        raise UsageError("sign-nobody", file=str(file), name=str(wish.by)[:64])
    own = wish.add == who.name and wish.role == who.role and wish.remove is None
    if who.role is not Role.ENGINEER and not own:
        raise UsageError("account-by-no-engineer", name=who.name, role=who.role.value)
    check_sealed(who, file, known_seal(database))
    if not accounts.verify_password(_output.read_password(who.name), who.password):
        raise UsageError("account-wrong-password", name=who.name)


def _name_of_plant(location: str) -> str:
    """The database as a title names it: where it is only if that is another machine."""
    host, _, name = location.removeprefix("postgresql://").rpartition("/")
    return name if host == "localhost" or host.startswith("/") else f"{name} ({host})"


def serve(where: PanelFiles, listen: ListenAddress, *, pace: float | None, faults: tuple[str, ...] = ()) -> int:
    """Serves until it is stopped. pace: of simulated runs; None: runs on the bench; faults: of simulated units."""
    settings = load_settings(where.config)
    plant = where.plant(settings)
    if plant:
        if pace is not None or where.recipe is not None:
            raise UsageError("panel-of-plant-reads")
        with open_log(plant) as log:
            settings = settings.model_copy(update={"station": _name_of_plant(log.location)})
    recipe = where.recipe or settings.recipe
    job, _ = load_job(recipe)
    order = LaunchOptions(
        where.database(settings),
        recipe,
        where.config,
        simulate=pace is not None,
        pace=pace,
        faults=faults,
        rehearsal=is_rehearsal(settings),
    )
    people = where.people(settings)
    if order.database.is_dir():
        raise StoreFault("log-not-opened", path=str(order.database), reason=Message("log-is-folder"))
    if not plant:
        check_is_log(order.database)
    if not accounts.load(people):
        if pace is None:
            raise ConfigError("panel-nobody", file=str(people))
        _add_demo_account(order.database, settings, people)
    panel = Panel(settings, job.recipe, order, people, plant, secure=listen.secure, host_names=listen.host_names)
    if plant:
        with suppress(KeyboardInterrupt):
            _serve(panel, listen)
        return 0
    # Ctrl-C is the way to stop it, and no failure.
    watched = watching_in_background(order.database, where.config, settings)
    sealed = sealing_in_background(order.database, settings, people)
    heard = listening_in_background(_listened_to(order), settings)
    with (
        serving(order.database),
        shipping_in_background(order.database, settings),
        watched,
        sealed,
        heard,
        suppress(KeyboardInterrupt),
    ):
        _serve(panel, listen)
    return 0


def _listened_to(order: LaunchOptions) -> RunOrder:
    """The units that a run of the page would find."""
    memory = Path(f"{order.database}.devices") if order.simulate and not order.rehearsal else None
    return RunOrder(
        order.recipe, order.config, order.database, order.simulate, faults=order.faults, device_state=memory
    )


def _serve(panel: Panel, listen: ListenAddress) -> None:
    import uvicorn

    from station.web.app import create_app
    from station.web.connections import LET_IN_AT_ONCE, MOST_WAITING, GuardedConnection, allow_connections

    door = _listening_socket(listen)
    host, port = door.getsockname()[:2]
    _output.print_line(f"http://{f'[{host}]' if ':' in host else host}:{port}")

    class Server(uvicorn.Server):
        """Stopping is its regular end: the open event streams end first, and no signal is raised again."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            door.listen(MOST_WAITING)  # asyncio has just listened with `backlog`, its word for both counts
            allow_connections()

        def handle_exit(self, sig: int, frame: object) -> None:  # noqa: ARG002
            panel.over = True
            self.should_exit = True

    options = uvicorn.Config(
        create_app(panel),
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=2,
        http=GuardedConnection,
        backlog=LET_IN_AT_ONCE,
        ws="none",
        proxy_headers=listen.proxy is not None,
        forwarded_allow_ips=listen.proxy,
    )
    Server(options).run(sockets=[door])


def _listening_socket(listen: ListenAddress) -> socket.socket:
    """A socket that already takes connections: whoever reads the address may come at once. Errors: StationFault."""
    try:
        family, _, _, _, address = socket.getaddrinfo(listen.host, listen.port, type=socket.SOCK_STREAM)[0]
        # asyncio sends at once (TCP_NODELAY) only where the socket says that it is TCP; else an answer waits 40 ms.
        door = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        try:
            door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            door.bind(address)
            door.listen(1024)
        except OSError:
            door.close()
            raise
    except (OSError, UnicodeError) as exc:
        raise StationFault("panel-not-listening", host=listen.host, port=listen.port, why=system_reason(exc)) from exc
    return door


def _add_demo_account(database: Path, settings: Settings, people: Path) -> None:
    """One engineer with a password that is said once, so that a demonstration needs no preparation."""
    seal = known_seal(database)
    if seal is not None and seal.has_engineer:  # whose engineer would have to vouch for it
        raise ConfigError("panel-nobody", file=str(people))
    password = secrets.token_urlsafe(9)
    change = AccountChange("demo", Account("demo", Role.ENGINEER, accounts.hash_password(password)))
    change_account(database, settings, people, change)
    _output.print_remark(render(Message("demo-login", password=password, file=str(people))))


def _read_password(name: str) -> str:
    """'' where a script gave none."""
    if not sys.stdin.isatty():
        return sys.stdin.readline(1000).rstrip("\r\n")
    first = _output.read_password(name)
    if getpass.getpass("once more: ") != first:
        raise UsageError("panel-passwords-differ")
    return first
