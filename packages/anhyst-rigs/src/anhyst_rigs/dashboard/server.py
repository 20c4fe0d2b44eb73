"""The server: the page, its assets, and one WebSocket."""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.responses import FileResponse
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from anhyst.support.atomic import plain
from anhyst.support.errors import InputError
from anhyst.support.states import Fault, Phase, State
from anhyst_rigs.dashboard.browsers import Allowance, Guard, Outbox, encode
from anhyst_rigs.dashboard.generator import HIGHEST_HZ, LOWEST_HZ, SHAPES
from anhyst_rigs.dashboard.orders import BESIDE, parameters_of, perform
from anhyst_rigs.dashboard.recording import KEPT_S, header
from anhyst_rigs.dashboard.session import WATCHES, LiveSession, all_refused
from anhyst_rigs.rig.bench.protocol import Parameter
from anhyst_rigs.study.improve import DrawnLoop

ASKED_S = 10.0
"""After so long without an answer the desk goes to whoever asked, s."""


class Desk:
    """The one seat from which the bench is operated."""

    def __init__(self) -> None:
        self.operator = 0
        self.asking = 0
        self._asked = 0.0

    def join(self, client: int) -> None:
        """Let a browser come; whoever finds the desk empty sits down."""
        if not self.operator:
            self.operator = client

    def leave(self, client: int) -> None:
        """Let a browser go; whoever asked gets its place."""
        if self.asking == client:
            self.asking = 0
        if self.operator == client:
            self.operator, self.asking = self.asking, 0

    def ask(self, client: int) -> None:
        """Ask to take over; an empty desk is taken at once, and one question waits at a time."""
        if not self.operator:
            self.operator = client
        elif client != self.operator and not self.asking:
            self.asking, self._asked = client, time.monotonic()

    def answer(self, client: int, hand_over: bool) -> None:
        """Let the operator hand over, or stay; nobody else can."""
        if client == self.operator and self.asking:
            self.operator = self.asking if hand_over else self.operator
            self.asking = 0

    def wait(self) -> None:
        """Hand over where the operator has not answered for too long."""
        if self.asking and time.monotonic() - self._asked >= ASKED_S:
            self.operator, self.asking = self.asking, 0


def describe(session: LiveSession, title: str, you: int) -> Mapping[str, Any]:
    """Return the first message to a page."""
    bench = session.bench
    return {
        "kind": "bench",
        "title": title,
        "you": you,
        "rate": bench.rate,
        "signals": [{**one._asdict(), "head": header(one)} for one in bench.signals],
        "aim": bench.aim._asdict(),
        "load_most": bench.load_most,
        "body": bench.body,
        "keeps_time": bench.keeps_time,
        "every": bench.every,
        "commands": [command.name.lower() for command in bench.commands],
        "states": _names(State),
        "faults": _names(Fault),
        "phases": _names(Phase),
        "parameters": parameters_of(session),
        "shapes": list(SHAPES),
        "frequencies": [LOWEST_HZ, HIGHEST_HZ],
        "folder": str(session.recorder.folder.resolve()),
        "kept": KEPT_S,
        "learns": None if session.learner is None else session.learner.unit,
        "limits": None if session.improver is None else session.improver.limits(),
        "loops": loops_of(session),
    }


def loops_of(session: LiveSession) -> list[dict[str, Any]]:
    """Return the loops to be drawn below the one that runs."""
    return [curve._asdict() for curve in session.curves]


def _names(kind: type[IntEnum]) -> dict[str, str]:
    return {str(int(one)): one.name.lower().replace("_", " ") for one in kind}


ASSETS = Path(__file__).with_name("assets")

MESSAGE_MOST = 16 * 1024
"""Bytes of a message from a page."""

CLIENTS_MOST = 8
"""Browsers at a time."""

_FRAMES_HZ = 60.0
_STATUS_S = 0.1
_HELLO_S = 10.0
_ANSWERS = 64
_RATE, _AT_ONCE = 60.0, 60
_BAD, _FULL = 1008, 1013

_Result = TypeVar("_Result")


class Client:
    """A browser: what waits for it, and who it is."""

    def __init__(self, number: int, socket: WebSocket, every: int) -> None:
        self.number = number
        self.socket = socket
        self.outbox = Outbox(every=every)
        self.logged, self.learnt = 0, 0
        self.parameters: tuple[Parameter, ...] = ()
        self.curves: tuple[DrawnLoop, ...] = ()
        self.results: Mapping[str, Any] = {}
        self._answers: deque[Mapping[str, Any]] = deque(maxlen=_ANSWERS)

    @property
    def name(self) -> str:
        """For the log."""
        return f"browser {self.number}"

    def answer(self, message: Mapping[str, Any]) -> None:
        """Send a message with the next frame."""
        self._answers.append(message)

    async def send_waiting(self) -> None:
        """Send all that waits; takes as long as the browser does."""
        while self._answers:
            await self.say(self._answers.popleft())
        for run in self.outbox.take():
            await self.socket.send_bytes(encode(run))

    async def say(self, message: Mapping[str, Any]) -> None:
        """Send a message."""
        await self.socket.send_text(json.dumps(plain(message), allow_nan=False))


class LiveServer:
    """Brings browsers and a session together."""

    def __init__(
        self, session: LiveSession, title: str, names: frozenset[str], token: str = ""
    ) -> None:
        self.session = session
        self.desk = Desk()
        self._title = title
        self._token = token
        self._clients: dict[int, Client] = {}
        self._count = 0
        routes = [*page_routes("index.html"), WebSocketRoute("/live", self._meet)]
        self.app = Guard(Starlette(routes=routes), names)

    async def _meet(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            if len(self._clients) >= CLIENTS_MOST:
                await socket.close(_FULL, "too many browsers")
            elif not await self._known(socket):
                await socket.close(_BAD, "the token is not right")
            else:
                await self._serve(socket)
        except (WebSocketDisconnect, TimeoutError):
            return

    async def _known(self, socket: WebSocket) -> bool:
        """Whether a browser shows the token, where one is needed."""
        if not self._token:
            return True
        await socket.send_text(json.dumps({"kind": "token"}))
        shown = str((await asyncio.wait_for(_receive(socket), _HELLO_S)).get("token"))
        if secrets.compare_digest(shown.encode(), self._token.encode()):
            return True
        await asyncio.sleep(1.0)
        return False

    async def _serve(self, socket: WebSocket) -> None:
        self._count += 1
        client = Client(self._count, socket, self.session.bench.every)
        self._clients[client.number] = client
        self.desk.join(client.number)
        client.parameters, client.curves = self.session.parameters, self.session.curves
        await client.say(describe(self.session, self._title, client.number))
        leave = self.session.listen(client.outbox.put)
        sender = asyncio.create_task(self._send(client))
        try:
            await self._listen(client)
        finally:
            leave()
            sender.cancel()
            self.desk.leave(client.number)
            del self._clients[client.number]

    async def _send(self, client: Client) -> None:
        """Send frames as fast as the browser takes them, and the status now and then."""
        clock = asyncio.get_running_loop().time
        due = 0.0
        try:
            while True:
                if clock() >= due:
                    due = clock() + _STATUS_S
                    self.desk.wait()
                    await self._say_status(client)
                await client.send_waiting()
                await asyncio.sleep(1.0 / _FRAMES_HZ)
        except (WebSocketDisconnect, RuntimeError):
            return  # the browser went while something was on its way; the reader sees it too

    async def _say_status(self, client: Client) -> None:
        await client.say(self._status(client))
        if client.parameters is not self.session.parameters:
            client.parameters = self.session.parameters
            values = {"parameters": parameters_of(self.session), "applied": self.session.applied}
            await client.say({"kind": "parameters", **values})
        if client.curves is not self.session.curves:
            client.curves = self.session.curves
            await client.say({"kind": "loops", "loops": loops_of(self.session)})
        learner = self.session.learner
        laps = [one for one in tuple(learner.laps) if one.tick > client.learnt] if learner else ()
        if laps:
            client.learnt = laps[-1].tick
            await client.say({"kind": "learnt", "laps": [one._asdict() for one in laps]})
        improver = self.session.improver
        if improver is not None and client.results is not improver.results:
            client.results = improver.results
            await client.say({"kind": "improve", "results": client.results})

    def _status(self, client: Client) -> Mapping[str, Any]:
        entries = list(self.session.log)
        new = min(self.session.logged - client.logged, len(entries))
        client.logged = self.session.logged
        status = self.session.status()
        if self.desk.operator != client.number:
            status = {**status, "refused": all_refused(self.session.bench, WATCHES), "next": ""}
        return {
            "kind": "status",
            **status,
            "operator": self.desk.operator,
            "asking": self.desk.asking,
            "browsers": len(self._clients),
            "log": [entry._asdict() for entry in entries[len(entries) - new :]],
        }

    async def _listen(self, client: Client) -> None:
        allowance = Allowance(_RATE, _AT_ONCE)
        while True:
            message = await _receive(client.socket)
            if not allowance.take():
                await client.socket.close(_BAD, "too many messages")
                return
            await self._do(client, message)

    async def _do(self, client: Client, message: Mapping[str, Any]) -> None:
        """Do what a browser asks for, and answer; the emergency stop is anybody's."""
        number = message.get("id")
        try:
            result = await self._perform(client, message)
        except InputError as error:
            result = {"reason": str(error)}
        client.answer({"kind": "answer", "id": number if isinstance(number, int) else 0, **result})

    async def _perform(self, client: Client, message: Mapping[str, Any]) -> Mapping[str, Any]:
        what = message.get("do")
        if what == "stop now":
            await self._between_chunks(lambda: self.session.stop(client.name))
            return {}
        if what == "ask":
            self.desk.ask(client.number)
            return {}
        if what == "hand over":
            self.desk.answer(client.number, message.get("yes") is True)
            return {}
        if self.desk.operator != client.number:
            raise InputError(WATCHES, code="another-operates")
        if (act := BESIDE.get(str(what))) is not None:
            return await asyncio.to_thread(act, self.session, client.name, message)
        return await self._between_chunks(lambda: perform(self.session, client.name, message))

    async def _between_chunks(self, act: Callable[[], _Result]) -> _Result:
        return await asyncio.to_thread(self.session.do, act)


def page_routes(name: str) -> list[BaseRoute]:
    """Return the routes of a page and of what it loads."""

    async def page(_request: object) -> FileResponse:
        return FileResponse(ASSETS / name)

    return [Route("/", page), Mount("/assets", StaticFiles(directory=ASSETS))]


async def _receive(socket: WebSocket) -> dict[str, Any]:
    """Return the next message; one that is no JSON object ends the connection."""
    text = await socket.receive()
    if text["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(text.get("code", 1005))
    try:
        message = json.loads(text.get("text") or "")
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        await socket.close(_BAD, "no JSON object")
        raise WebSocketDisconnect(_BAD)
    return message
