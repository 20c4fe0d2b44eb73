"""Serve the page, its files, and one WebSocket for each browser."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from anhyst.support.atomic import to_json_value
from anhyst.support.errors import InputError
from anhyst.support.kinds import METHOD_TITLES
from anhyst.support.states import Fault, Phase, State
from anhyst_rigs.dashboard.browsers import MessageRateLimit, RequestGuard, RowQueue, encode_frame
from anhyst_rigs.dashboard.connections import page_routes
from anhyst_rigs.dashboard.derived import DerivedSignal
from anhyst_rigs.dashboard.generator import HIGHEST_HZ, LOWEST_HZ, WAVE_SHAPES
from anhyst_rigs.dashboard.orders import ORDERS_BESIDE_BENCH, describe_parameters, perform
from anhyst_rigs.dashboard.recording import BUFFER_S
from anhyst_rigs.dashboard.recordings import ListedRecording, RecordingRoute
from anhyst_rigs.dashboard.response import describe_response
from anhyst_rigs.dashboard.session import LiveSession, refuse_all_orders
from anhyst_rigs.rig.bench.protocol import Parameter, Signal, column_header
from anhyst_rigs.study.improve import DrawnLoop
from anhyst_rigs.study.response.result import FrequencyResponse

CONTROL_REQUEST_TIMEOUT_S = 10.0
"""Time limit of an operator's answer to a request for control, s; then the request is granted."""


class OperatorDesk:
    """The rule that determines which browser operates the bench; all other browsers only watch."""

    def __init__(self) -> None:
        self.operator = 0
        self.requesting_client = 0
        self._request_time = 0.0

    def refusal_reason(self, client: int) -> str:
        """Why a browser cannot operate the bench now; empty if it can."""
        if self.operator == client:
            return ""
        return "another browser operates; ask to take over" if self.operator else "nobody operates; take over"

    def join(self, client: int) -> None:
        """Add a browser, which becomes the operator if there is none."""
        if not self.operator:
            self.operator = client

    def leave(self, client: int) -> None:
        """Remove a browser. If it was the operator, the browser that requests control takes over."""
        if self.requesting_client == client:
            self.requesting_client = 0
        if self.operator == client:
            self.operator, self.requesting_client = self.requesting_client, 0

    def request(self, client: int) -> None:
        """Request control for a browser; it is granted if nobody operates. Only one can wait."""
        if not self.operator:
            self.operator = client
        elif client != self.operator and not self.requesting_client:
            self.requesting_client, self._request_time = client, time.monotonic()

    def answer(self, client: int, hand_over: bool) -> None:
        """Grant or reject the waiting request; only the operator may answer."""
        if client == self.operator and self.requesting_client:
            self.operator = self.requesting_client if hand_over else self.operator
            self.requesting_client = 0

    def check_timeout(self) -> None:
        """Grant the waiting request if the operator has not answered in time."""
        if self.requesting_client and time.monotonic() - self._request_time >= CONTROL_REQUEST_TIMEOUT_S:
            self.operator, self.requesting_client = self.requesting_client, 0


def make_welcome_message(session: LiveSession, title: str, client_number: int) -> Mapping[str, Any]:
    """Return the first message that a page receives."""
    bench = session.bench
    return {
        "kind": "bench",
        "title": title,
        "you": client_number,
        "rate": bench.rate,
        "signals": describe_signals(session),
        "aim": bench.demand_range._asdict(),
        "load_most": bench.max_load,
        "body": bench.body,
        "catalogue": None if bench.catalogue is None else bench.catalogue._asdict(),
        "keeps_time": bench.has_own_clock,
        "every": bench.ticks_per_row,
        "commands": [command.name.lower() for command in bench.commands],
        "states": _enum_names(State),
        "faults": _enum_names(Fault),
        "phases": _enum_names(Phase),
        "parameters": describe_parameters(session),
        "shapes": list(WAVE_SHAPES),
        "frequencies": [LOWEST_HZ, HIGHEST_HZ],
        "folder": str(session.recorder.folder.resolve()),
        "kept": BUFFER_S,
        "response": None if bench.injection_port is None else {"max_motion": bench.injection_port.max_motion},
        "learns": None if session.learner is None else session.learner.unit,
        "methods": METHOD_TITLES,
        "limits": None if session.improver is None else session.improver.limits(),
        "loops": describe_loops(session),
        "recordings": describe_recordings(session),
    }


def describe_signals(session: LiveSession) -> list[dict[str, Any]]:
    """Return the signals of the bench and the derived ones, in the order of their columns."""
    derived = [{**_describe(one.signal), "expression": one.expression} for one in session.derived.definitions]
    return [*map(_describe, session.bench.signals), *derived]


def _describe(signal: Signal) -> dict[str, Any]:
    return {**signal._asdict(), "head": column_header(signal)}


def describe_loops(session: LiveSession) -> list[dict[str, Any]]:
    """Return the loops that the page draws behind the running loop."""
    return [curve._asdict() for curve in session.curves]


def describe_recordings(session: LiveSession) -> list[dict[str, Any]]:
    """Return the list of the finished recordings."""
    return [recording._asdict() for recording in session.recorder.finished.recordings]


def _enum_names(kind: type[IntEnum]) -> dict[str, str]:
    return {str(int(member)): member.name.lower().replace("_", " ") for member in kind}


MAX_MESSAGE_BYTES = 16 * 1024
"""Maximum size of a message from a page, bytes."""

MAX_CLIENTS = 8
"""Maximum number of browsers."""

_FRAME_RATE_HZ = 60.0
_STATUS_PERIOD_S = 0.1
_TOKEN_TIMEOUT_S = 10.0
_MAX_QUEUED_ANSWERS = 64
_MESSAGE_RATE_HZ, _MESSAGE_BURST = 60.0, 60
_CLOSE_BAD_MESSAGE, _CLOSE_SERVER_FULL = 1008, 1013

_FOLDERS_PATTERN = re.compile(r"(?<![\w:/.])/(?:[^/\s:]+/)+")
"""Folders of an absolute path in a text."""

_Result = TypeVar("_Result")


class Client:
    """A browser that is connected, and the data that wait for it."""

    def __init__(self, client_number: int, socket: WebSocket) -> None:
        self.number = client_number
        self.socket = socket
        self.outbox = RowQueue()
        self.leave: Callable[[], None] = lambda: None  # ends the subscription
        self.sent_log_entries, self.sent_laps = 0, 0
        self.signals: tuple[Signal, ...] = ()
        self.parameters: tuple[Parameter, ...] = ()
        self.curves: tuple[DrawnLoop, ...] = ()
        self.results: Mapping[str, Any] = {}
        self.response: FrequencyResponse | None = None
        self.derived: tuple[DerivedSignal, ...] = ()
        self.recordings: tuple[ListedRecording, ...] = ()
        self._answers: deque[Mapping[str, Any]] = deque(maxlen=_MAX_QUEUED_ANSWERS)

    @property
    def name(self) -> str:
        """Name of the browser in the log."""
        return f"browser {self.number}"

    def queue_message(self, message: Mapping[str, Any]) -> None:
        """Queue a message, which is sent before the next frame."""
        self._answers.append(message)

    async def send_waiting(self) -> None:
        """Send all data that wait; this takes long if the browser is slow."""
        while self._answers:
            await self.send_message(self._answers.popleft())
        for run in self.outbox.take_all():
            await self.socket.send_bytes(encode_frame(run))

    async def send_message(self, message: Mapping[str, Any]) -> None:
        """Send a message."""
        await self.socket.send_text(json.dumps(to_json_value(message), allow_nan=False))


class LiveServer:
    """A server that connects browsers with a session."""

    def __init__(self, session: LiveSession, title: str, names: frozenset[str], token: str = "") -> None:
        self.session = session
        self.desk = OperatorDesk()
        self._title = title
        self._token = token
        self._clients: dict[int, Client] = {}
        self._client_count = 0
        self._downloads = RecordingRoute(lambda: session.recorder.finished)
        socket_route = WebSocketRoute("/live", self._accept_browser)
        routes = [*page_routes("index.html"), socket_route, self._downloads.route]
        self.app = RequestGuard(Starlette(routes=routes), names)

    async def _accept_browser(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            if len(self._clients) >= MAX_CLIENTS:
                await socket.close(_CLOSE_SERVER_FULL, "too many browsers")
            elif not await self._has_token(socket):
                await socket.close(_CLOSE_BAD_MESSAGE, "the token is not right")
            else:
                await self._serve_client(socket)
        except (WebSocketDisconnect, TimeoutError):
            return

    async def _has_token(self, socket: WebSocket) -> bool:
        """Whether a browser sends the token, if a token is required."""
        if not self._token:
            return True
        await socket.send_text(json.dumps({"kind": "token"}))
        received_token = str(
            (await asyncio.wait_for(_receive_message(socket), _TOKEN_TIMEOUT_S)).get("token")
        )
        if secrets.compare_digest(received_token.encode(), self._token.encode()):
            return True
        await asyncio.sleep(1.0)
        return False

    async def _serve_client(self, socket: WebSocket) -> None:
        self._client_count += 1
        client = Client(self._client_count, socket)
        self._clients[client.number] = client
        self.desk.join(client.number)
        await self._send_welcome(client)
        sender = asyncio.create_task(self._send_frames(client))
        try:
            await self._receive_messages(client)
        finally:
            client.leave()
            sender.cancel()
            self.desk.leave(client.number)
            del self._clients[client.number]

    async def _send_welcome(self, client: Client) -> None:
        """Describe the bench to a browser, and subscribe it to the rows of the present signals."""
        client.signals = self.session.signals
        client.outbox = RowQueue(ticks_per_row=self.session.bench.ticks_per_row)
        client.parameters, client.curves = self.session.parameters, self.session.curves
        client.derived = self.session.derived.definitions
        client.recordings = self.session.recorder.finished.recordings
        welcome = make_welcome_message(self.session, self._title, client.number)
        await client.send_message({**welcome, "downloads": self._downloads.address})
        client.leave()
        client.leave = self.session.subscribe(client.outbox.put)

    async def _send_frames(self, client: Client) -> None:
        """Send frames as fast as the browser accepts them, and the status at regular times."""
        clock = asyncio.get_running_loop().time
        due_time = 0.0
        try:
            while True:
                if client.signals is not self.session.signals:
                    await self._send_welcome(client)
                if clock() >= due_time:
                    due_time = clock() + _STATUS_PERIOD_S
                    self.desk.check_timeout()
                    await self._send_status(client)
                if client.derived is not self.session.derived.definitions:
                    client.derived = self.session.derived.definitions
                    await client.send_message({"kind": "signals", "signals": describe_signals(self.session)})
                await client.send_waiting()
                await asyncio.sleep(1.0 / _FRAME_RATE_HZ)
        except (WebSocketDisconnect, RuntimeError):
            return  # The browser left during a transmission, which the receiver detects too.

    async def _send_status(self, client: Client) -> None:
        await client.send_message(self._make_status(client))
        if client.parameters is not self.session.parameters:
            client.parameters = self.session.parameters
            values = {
                "parameters": describe_parameters(self.session),
                "applied": self.session.last_applied_tick,
            }
            await client.send_message({"kind": "parameters", **values})
        if client.curves is not self.session.curves:
            client.curves = self.session.curves
            await client.send_message({"kind": "loops", "loops": describe_loops(self.session)})
        if client.recordings is not self.session.recorder.finished.recordings:
            client.recordings = self.session.recorder.finished.recordings
            await client.send_message({"kind": "recordings", "recordings": describe_recordings(self.session)})
        learner = self.session.learner
        laps = [lap for lap in tuple(learner.laps) if lap.tick > client.sent_laps] if learner else ()
        if laps:
            client.sent_laps = laps[-1].tick
            await client.send_message(
                {"kind": "learnt", "laps": [lap_result._asdict() for lap_result in laps]}
            )
        if client.response is not self.session.meter.result:
            client.response = self.session.meter.result
            await client.send_message(describe_response(client.response))
        improver = self.session.improver
        if improver is not None and client.results is not improver.results:
            client.results = improver.results
            await client.send_message({"kind": "improve", "results": client.results})

    def _make_status(self, client: Client) -> Mapping[str, Any]:
        entries = list(self.session.log)
        new_count = min(self.session.log_entry_count - client.sent_log_entries, len(entries))
        client.sent_log_entries = self.session.log_entry_count
        status = self.session.status()
        if reason := self.desk.refusal_reason(client.number):
            status = {**status, "refused": refuse_all_orders(self.session.bench, reason), "next": ""}
        return {
            "kind": "status",
            **status,
            "operator": self.desk.operator,
            "asking": self.desk.requesting_client,
            "browsers": len(self._clients),
            "log": [entry._asdict() for entry in entries[len(entries) - new_count :]],
        }

    async def _receive_messages(self, client: Client) -> None:
        allowance = MessageRateLimit(_MESSAGE_RATE_HZ, _MESSAGE_BURST)
        while True:
            message = await _receive_message(client.socket)
            if not allowance.accept_message():
                await client.socket.close(_CLOSE_BAD_MESSAGE, "too many messages")
                return
            await self._handle_message(client, message)

    async def _handle_message(self, client: Client, message: Mapping[str, Any]) -> None:
        """Execute the order of a browser, and answer it. Every browser may stop the rig."""
        message_number = message.get("id")
        try:
            reply = await self._perform_order(client, message)
        except InputError as error:
            # A page shows the name of a file, and not the folders of the server.
            reply = {"reason": _FOLDERS_PATTERN.sub("", str(error))}
        client.queue_message(
            {"kind": "answer", "id": message_number if isinstance(message_number, int) else 0, **reply}
        )

    async def _perform_order(self, client: Client, message: Mapping[str, Any]) -> Mapping[str, Any]:
        order = message.get("do")
        if order == "stop now":
            await self._run_between_chunks(lambda: self.session.stop(client.name))
            return {}
        if order == "ask":
            self.desk.request(client.number)
            return {}
        if order == "hand over":
            self.desk.answer(client.number, message.get("yes") is True)
            return {}
        if reason := self.desk.refusal_reason(client.number):
            raise InputError(reason, code="another-operates")
        if (act := ORDERS_BESIDE_BENCH.get(str(order))) is not None:
            return await asyncio.to_thread(act, self.session, client.name, message)
        return await self._run_between_chunks(lambda: perform(self.session, client.name, message))

    async def _run_between_chunks(self, act: Callable[[], _Result]) -> _Result:
        return await asyncio.to_thread(self.session.run_between_chunks, act)


async def _receive_message(socket: WebSocket) -> dict[str, Any]:
    """Return the next message. A message that is not a JSON object ends the connection."""
    text = await socket.receive()
    if text["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(text.get("code", 1005))
    try:
        message = json.loads(text.get("text") or "")
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        await socket.close(_CLOSE_BAD_MESSAGE, "no JSON object")
        raise WebSocketDisconnect(_CLOSE_BAD_MESSAGE)
    return message
