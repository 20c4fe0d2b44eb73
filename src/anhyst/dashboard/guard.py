"""Who may talk to the server: addresses, names, origins, and how much."""

from __future__ import annotations

import ipaddress
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from anhyst.support.errors import InputError

PORT = 8642

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What the page may load: its own files, no inline script or style, nothing from elsewhere."""

_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)


def read_address(text: str, token: bool) -> tuple[str, int]:
    """Read an address to listen on."""
    host, colon, port = text.rpartition(":")
    host = host.strip("[]") if colon else "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
        number = int(port)
    except ValueError:
        raise InputError(
            f"--listen {text}: is no address; give it in digits, such as 127.0.0.1:{PORT}",
            code="bad-address",
            key="--listen",
        ) from None
    if not 0 <= number <= 65535:
        raise InputError(
            f"--listen {text}: the port is not within 0 to 65535",
            code="out-of-range",
            key="--listen",
        )
    if address.is_unspecified:
        raise InputError(
            f"--listen {text}: name the one address by which browsers will call it",
            code="bad-address",
            key="--listen",
        )
    if not address.is_loopback and not token:
        raise InputError(
            f"--listen {text}: reaches beyond this machine; add --token",
            code="token-missing",
            key="--listen",
        )
    return str(address), number


def names_of(host: str, port: int) -> frozenset[str]:
    """Return what a browser may call the server, as in the header ``Host``."""
    shown = f"[{host}]" if ":" in host else host
    names = {shown}
    if ipaddress.ip_address(host).is_loopback:
        names.add("localhost")
    return frozenset(f"{name}:{port}" for name in names)


class Guard:
    """Refuses requests that another site caused, and says what the page may load.

    A name that leads to this machine by somebody else's name server is not among the names; a
    request from another site's page carries its origin. A WebSocket without origin is refused too.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app = app
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if not self._welcome(scope):
            await _refuse(scope, receive, send)
        else:
            await self._app(scope, receive, _with_headers(send))

    def _welcome(self, scope: Scope) -> bool:
        hosts = _header(scope, b"host")
        origins = _header(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self._names:
            return False
        if not origins:
            return bool(scope["type"] == "http")
        return origins == [f"http://{hosts[0]}"]


class Allowance:
    """So many messages a second, and a few at once."""

    def __init__(self, rate: float, most: int) -> None:
        self._rate = rate
        self._most = float(most)
        self._left = float(most)
        self._then = time.monotonic()

    def take(self) -> bool:
        """Use one message of the allowance; whether there was one."""
        now = time.monotonic()
        self._left = min(self._most, self._left + self._rate * (now - self._then))
        self._then = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _header(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    """Close a WebSocket before it opens, which is a 403 too, or answer 403."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    head = [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": head})
    await send({"type": "http.response.body", "body": b"another host or origin\n"})


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_HEADERS]
        await send(message)

    return sending
