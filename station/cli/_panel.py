"""The face of the page: people in and out, then a server until it is stopped."""

import getpass
import secrets
import socket
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from station.cli import _output
from station.config.settings import Settings, load_settings
from station.errors import ConfigError, StationFault, UsageError
from station.messages import Message, render, system_reason
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.presence import serving
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.alerts import watching_beside
from station.wiring.jobs import load_job
from station.wiring.rehearsal import is_rehearsal
from station.wiring.shipping import shipping_beside


@dataclass(frozen=True, slots=True)
class PanelFiles:
    """What the command line says about files; None: as config.yaml says, or beside the log."""

    recipe: str | None
    config: Path | None
    db: Path | None
    accounts: Path | None

    def database(self, settings: Settings) -> Path:
        """The log."""
        return self.db or Path(settings.database)

    def people(self, settings: Settings) -> Path:
        """The file of the people."""
        return self.accounts or self.database(settings).with_name("accounts.json")


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


def change_accounts(where: PanelFiles, add: str | None, remove: str | None, role: str) -> int:
    """Adds or removes one person. Errors: UsageError, ConfigError."""
    path = where.people(load_settings(where.config))
    people = accounts.load(path)
    if remove is not None and people.pop(remove, None) is None:
        raise UsageError("panel-no-person", file=str(path), name=remove, people=tuple(people))
    if add is not None:
        if not add.isprintable() or not 0 < len(add) <= 64:
            raise UsageError("panel-name-form")
        if role not in list(Role):
            raise UsageError("panel-unknown-role", role=role, roles=tuple(Role))
        people[add] = Account(add, Role(role), accounts.hash_password(_read_password(add)))
    accounts.save(path, people)
    _output.print_line(f"{path}: {', '.join(f'{p.name} ({p.role})' for p in people.values()) or 'nobody'}")
    return 0


def serve(where: PanelFiles, listen: ListenAddress, *, pace: float | None, faults: tuple[str, ...] = ()) -> int:
    """Serves until it is stopped. pace: of simulated runs; None: runs on the bench; faults: of simulated units."""
    settings = load_settings(where.config)
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
    if not accounts.load(people):
        if pace is None:
            raise ConfigError("panel-nobody", file=str(people))
        _add_demo_account(people)
    panel = Panel(settings, job.recipe, order, people, secure=listen.secure, host_names=listen.host_names)
    # Ctrl-C is the way to stop it, and no failure.
    watched = watching_beside(order.database, where.config, settings)
    with serving(order.database), shipping_beside(order.database, settings), watched, suppress(KeyboardInterrupt):
        _serve(panel, listen)
    return 0


def _serve(panel: Panel, listen: ListenAddress) -> None:
    import uvicorn

    from station.web.app import create_app
    from station.web.connections import GuardedConnection, allow_connections

    allow_connections()
    door = _listening_socket(listen)
    host, port = door.getsockname()[:2]
    _output.print_line(f"http://{f'[{host}]' if ':' in host else host}:{port}")

    class Server(uvicorn.Server):
        """Stopping is its regular end: the open event streams end first, and no signal is raised again."""

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
    except OSError as exc:
        raise StationFault("panel-not-listening", host=listen.host, port=listen.port, why=system_reason(exc)) from exc
    return door


def _add_demo_account(people: Path) -> None:
    """One engineer with a password that is said once, so that a demonstration needs no preparation."""
    password = secrets.token_urlsafe(9)
    accounts.save(people, {"demo": Account("demo", Role.ENGINEER, accounts.hash_password(password))})
    _output.print_remark(render(Message("demo-login", password=password, file=str(people))))


def _made_password(name: str) -> str:
    """A password for a script that gave none; it is said once."""
    password = secrets.token_urlsafe(9)
    _output.print_line(render(Message("password-made", name=name, password=password)))
    return password


def _read_password(name: str) -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline(1000).rstrip("\r\n") or _made_password(name)
    first = getpass.getpass(f"password of {name}: ")
    if getpass.getpass("once more: ") != first:
        raise UsageError("panel-passwords-differ")
    return first
