"""A client of an OPC UA server: readings of its nodes, through restarts, bad quality and silence.

The client lives in a thread of its own. It subscribes to the nodes, and asks for their values twice a second: so a
server that hangs, or a subscription that gives nothing, is noticed, and a load that does not change is known to be so.
"""

import asyncio
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from ipaddress import ip_address
from queue import Empty, Full, Queue
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from ...core.bounded import read_bounded
from ...core.errors import FitmodelsError, UsageError
from ...core.files import cause
from ...core.text import one_line, shortened
from ..samples import Notice, Sample
from .channels import Channels, channels_for
from .clock import arrival_time
from .merging import Held, Merger, Reading
from .opcua_nodes import Nodes, find_nodes, value_of
from .options import SourceOptions

if TYPE_CHECKING:
    from asyncua import ua
    from asyncua.client.client import Client

PUBLISH: Final = 50.0  # ms between two notifications of the server
QUEUE: Final = 1000  # values that the server keeps between them
CHECK: Final = 0.5  # s between two questions for all values
ANSWER: Final = 2.0  # s for an answer, after which the server is lost
AGAIN: Final = 1.0  # s between two attempts to connect
BEHIND: Final = 2.0  # s that notifications may be behind the values of the server
IDLE: Final = 0.5  # s
MOST: Final = 100_000  # readings that wait for the monitor
Items = Iterator[Sample | Notice]


@dataclass(frozen=True, slots=True)
class _Connected:
    channels: Channels
    text: str


@dataclass(frozen=True, slots=True)
class _Checked:
    held: Sequence[Held]
    server: float
    arrival: float


def check_security(url: str, options: SourceOptions) -> None:
    """Refuse a connection off the loopback without certificates, and certificates without their keys.

    Raises
    ------
    UsageError

    Examples
    --------
    >>> check_security("opc.tcp://127.0.0.1:4840", SourceOptions())
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise UsageError(f"--from {shortened(url, 100)}: give host and port, as in opc.tcp://192.168.0.10:4840.")
    if parts.username or parts.password:
        raise UsageError("a password in an address is seen by others: give --user NAME and --password-file FILE.")
    given = [options.certificate, options.key, options.server_certificate]
    if any(given) and not all(given):
        raise UsageError("SignAndEncrypt needs --certificate, --key and --server-certificate together.")
    if not all(given) and not _is_loopback(host):
        raise UsageError(
            f"{host} is not this computer: the connection has to be signed and encrypted. Give --certificate and --key "
            "of this program, and --server-certificate of the server."
        )
    for path in filter(None, (*given, options.password_file)):
        try:
            read_bounded(path, "text", UsageError)
        except OSError as error:
            raise UsageError(f"{path}: {cause(error)}.") from None


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class OpcUa:
    """Readings of an OPC UA server.

    Parameters
    ----------
    url : str
        ``opc.tcp://host:port/path``.
    options : SourceOptions

    Raises
    ------
    UsageError
        The connection would be neither on the loopback nor encrypted.
    """

    def __init__(self, url: str, options: SourceOptions) -> None:
        if find_spec("asyncua") is None:
            raise UsageError("OPC UA needs the package asyncua: pip install 'fitmodels[live]'.")
        check_security(url, options)
        self.name = url
        self._options = options
        self._queue: Queue[Any] = Queue(MOST)
        self._dropped = 0
        self._closing = threading.Event()

    def items(self) -> Items:
        """Samples and notices, until closed.

        Raises
        ------
        FitmodelsError
            At the first connection: a node is not there, or its unit does not fit.
        """
        thread = threading.Thread(target=self._thread, daemon=True, name="OPC UA")
        thread.start()
        consumer = _Consumer()
        given = time.monotonic()
        try:
            while True:
                for item in consumer.take(self._received(IDLE if consumer.quiet else PUBLISH / 1000)):
                    given = time.monotonic()
                    yield item
                if time.monotonic() - given >= IDLE:
                    given = time.monotonic()
                    yield Notice(time.time(), "idle")
        finally:
            self._closing.set()
            thread.join(2 * ANSWER)

    def _received(self, wait: float) -> list[Any]:
        """The items that came from the thread; waits for the first for some seconds."""
        received = []
        with suppress(Empty):
            received.append(self._queue.get(timeout=wait))
            while True:
                received.append(self._queue.get_nowait())
        if self._dropped:
            received.append(Notice(time.time(), "gap", f"{self._dropped} readings were dropped: the queue was full"))
            self._dropped = 0
        return received

    def _put(self, item: object) -> None:
        try:
            self._queue.put_nowait(item)
        except Full:
            self._dropped += 1

    def _thread(self) -> None:
        for name in ("asyncua", "uaprocessor"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # each is a notice of ours
        with asyncio.Runner() as runner:
            runner.get_loop().set_exception_handler(lambda loop, context: None)
            runner.run(self._connect_again_and_again())

    async def _connect_again_and_again(self) -> None:
        known = lost = False
        while not self._closing.is_set():
            try:
                async for _ in self._session():
                    known, lost = True, False
            except FitmodelsError as error:
                self._put(Notice(time.time(), "refused", str(error)) if known else error)
                if not known:
                    return
                lost = True
            except Exception as error:
                if not lost:
                    self._put(Notice(time.time(), "lost", f"{self.name}: {_reason(error)}; trying again"))
                lost = True
            await self._pause(AGAIN)

    async def _pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not self._closing.is_set() and (left := end - time.monotonic()) > 0:
            await asyncio.sleep(min(left, 0.1))

    async def _session(self) -> AsyncIterator[None]:
        """One connection: gives a value once it stands, then checks until it is closed or fails."""
        client = await self._client()
        try:
            await asyncio.wait_for(client.connect(), 2 * ANSWER)
            found = await find_nodes(client, self._options, self.name)
            channels = channels_for(found.places, self._options, self.name)
            order = [channel.symbol for channel in channels.channels]
            text = "; ".join([f"{self.name}: {channels.describe()}", *found.notes])
            self._put(_Connected(channels, text))
            handler = await self._subscribe(client, found, order)
            yield
            while not self._closing.is_set():
                handler.compare(await self._check(client, found, order))
                await self._pause(CHECK)
        finally:
            with suppress(Exception):
                await asyncio.wait_for(client.disconnect(), ANSWER / 2)
            with suppress(Exception):  # a server that hangs is not waited for
                client.disconnect_socket()
                await asyncio.sleep(0.01)

    async def _client(self) -> "Client":
        from asyncua.client.client import Client
        from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

        options = self._options
        client = Client(self.name, timeout=ANSWER, watchdog_intervall=ANSWER)
        client.name = client.description = "fitmodels watch"
        if options.certificate and options.key and options.server_certificate:
            client.application_uri = _uri_of(options) or client.application_uri
            await client.set_security(
                SecurityPolicyBasic256Sha256, options.certificate, options.key,
                server_certificate=str(options.server_certificate),
            )  # fmt: skip
        if options.user:
            client.set_user(options.user)
        if options.password_file:
            client.set_password(read_bounded(options.password_file, "text", UsageError).decode().partition("\n")[0])
        return client

    async def _subscribe(self, client: "Client", found: Nodes, order: Sequence[str]) -> "_Handler":
        from asyncua import ua

        handler = _Handler(self._put, found, order)
        subscription = await client.create_subscription(PUBLISH, handler)
        nodes = [found.nodes[symbol] for symbol in order]
        handler.places = {node: place for place, node in enumerate(nodes)}
        await subscription.subscribe_data_change(nodes, queuesize=QUEUE, sampling_interval=ua.Double(0.0))
        return handler

    async def _check(self, client: "Client", found: Nodes, order: Sequence[str]) -> Sequence[Held]:
        """Ask for all values and the time of the server."""
        from asyncua.ua.object_ids import ObjectIds

        clock = client.get_node(ObjectIds.Server_ServerStatus_CurrentTime)
        nodes = [*(found.nodes[symbol] for symbol in order), clock]
        results = await asyncio.wait_for(client.read_attributes(nodes), ANSWER)
        *values, now = results
        server = now.Value.Value if now.Value is not None else None
        stamp = _seconds(server) if isinstance(server, datetime) else time.time()
        held = [_held(symbol, value, found) for symbol, value in zip(order, values, strict=True)]
        self._put(_Checked(held, stamp, arrival_time()))
        return held


class _Handler:
    """Takes the notifications of a subscription."""

    def __init__(self, put: Callable[[object], None], found: Nodes, order: Sequence[str]) -> None:
        self._put, self._found, self._order = put, found, order
        self.places: dict[Any, int] = {}
        self._given = Counter[int]()  # notifications by place
        self._before: tuple[float, Sequence[Held], Counter[int]] | None = None

    def compare(self, held: Sequence[Held]) -> None:
        """ConnectionError where a value of the server changed and no notification of it came, for 2 s."""
        now = time.monotonic()
        if self._before is not None and now - self._before[0] < BEHIND:
            return
        if self._before is not None:
            _, former, given = self._before
            pairs = enumerate(zip(former, held, strict=True))
            if any(
                (old.value, old.bad) != (new.value, new.bad) and given[k] == self._given[k] for k, (old, new) in pairs
            ):
                raise ConnectionError(0, f"no notification of values that changed {BEHIND:g} s ago")
        self._before = now, held, self._given.copy()

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:  # noqa: ANN401  of asyncua
        """Pass one value on."""
        place = self.places.get(node)
        if place is None:
            return
        held = _held(self._order[place], data.monitored_item.Value, self._found)
        moment = time.time() if held.time is None else held.time
        self._put(Reading(place, moment, held.value, held.bad, arrival_time(), not self._given[place]))
        self._given[place] += 1

    def status_change_notification(self, status: Any) -> None:  # noqa: ANN401  of asyncua
        """Nothing: the values are asked for twice a second."""


class _Consumer:
    """The samples that the thread gives."""

    def __init__(self) -> None:
        self._merger: Merger | None = None
        self._channels: Channels | None = None

    @property
    def quiet(self) -> bool:
        """Whether nothing waits for the other loads of a sample."""
        return self._merger is None or not self._merger.waiting

    def take(self, received: Sequence[Any]) -> Items:
        for item in received:
            if isinstance(item, FitmodelsError):
                raise item
            if isinstance(item, Notice):
                yield item
            elif isinstance(item, _Connected):
                yield self._connected(item)
            elif self._merger is None:
                continue
            elif isinstance(item, Reading):
                yield from self._merger.add(item)
            elif isinstance(item, _Checked):
                yield from self._checked(self._merger, item)
        if self._merger is not None:
            yield from self._merger.take(arrival_time())

    def _connected(self, item: _Connected) -> Notice:
        if self._merger is None or item.channels != self._channels:
            self._merger = Merger(item.channels)
        self._merger.reconnected()
        self._channels = item.channels
        return Notice(time.time(), "connected", item.text)

    def _checked(self, merger: Merger, item: _Checked) -> Items:
        yield from merger.take(arrival_time())
        yield from merger.confirm(item.held, item.server, item.arrival)


def _seconds(stamp: datetime) -> float:
    """S since 1970 of a time of OPC UA, which is UTC."""
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def _held(symbol: str, answer: "ua.DataValue", found: Nodes) -> Held:
    """Time (of the source, otherwise of the server), value and quality of a node."""
    stamp = answer.SourceTimestamp or answer.ServerTimestamp
    status = answer.StatusCode
    bad = "" if status is None or status.is_good() else status.name
    value = None if answer.Value is None else value_of(symbol, answer.Value.Value, found.modelled)
    if value is None and not bad:
        bad = "no value"
    return Held(None if stamp is None else _seconds(stamp), None if bad else value, bad)


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return f"no answer for {ANSWER:g} s"
    if isinstance(error, OSError):
        return os.strerror(error.errno).lower() if error.errno else one_line(error.strerror or error)[:200]
    return one_line(f"{type(error).__name__}: {error}")[:200]


def _uri_of(options: SourceOptions) -> str:
    """Application URI of our certificate, which the server compares."""
    from cryptography import x509

    assert options.certificate is not None  # noqa: S101  all three are given
    content = read_bounded(options.certificate, "text", UsageError)
    try:
        load = x509.load_pem_x509_certificate if b"-----BEGIN" in content else x509.load_der_x509_certificate
        names = load(content).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")
    except x509.ExtensionNotFound:
        return ""
    except ValueError:
        raise UsageError(f"{options.certificate}: is no certificate in PEM or DER.") from None
