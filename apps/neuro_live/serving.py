"""The process that serves the page: `python -m neuro_live.serving DESCRIPTOR`, started by `neuro_live.page`.

This process serves four files, and forwards the messages of the network's process and small requests of the browsers
without interpreting either. All queues are bounded: a browser that reads slowly misses frames, a browser that sends too
much is disconnected, and requests are refused while the network's process is busy.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import signal
import socket
import sys
import time
from collections import deque
from contextlib import suppress
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from neuro.apps import html
from neuro_live.channel import SIZES, Head, packed

MOST_CLIENTS = 16
LONGEST_MESSAGE = 4096
"""Largest message from a browser, bytes."""
MESSAGES_PER_S = 60.0
BURST = 120.0
"""Number of messages that a browser may send at once, after a pause."""
WAITING = 1 << 16
"""Bytes that may wait for the network's process; above, requests are answered by an error."""
REPLIES, MOST_WAITING = 64, 64 << 20
"""Largest number of replies that wait for a browser, and their largest size in bytes."""
OPEN_S = 5.0

_FOLDER = Path(__file__).parent
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Client:
    """A connected browser, with the messages to send and the limit of its requests.

    Args:
        connection: the WebSocket.
        messages: the present messages by key.
    """

    def __init__(self, connection: ServerConnection, messages: dict[str, str]) -> None:
        self.connection = connection
        self._messages, self._frame = dict(messages), b""
        self._replies: deque[str | bytes] = deque(maxlen=REPLIES)
        self._wake = asyncio.Event()
        self._wake.set()
        self._allowed, self._since = BURST, time.monotonic()

    def keep(self, key: str, text: str, fresh: bool) -> None:
        """Queue a message, which replaces a waiting message with the same key, or all messages if `fresh`."""
        if fresh:
            self._messages.clear()
        self._messages[key] = text
        self._wake.set()

    def frame(self, frame: bytes) -> None:
        """Queue a frame, which replaces a waiting frame."""
        self._frame = frame
        self._wake.set()

    def reply(self, reply: str | bytes) -> None:
        """Queue a reply, unless too many bytes of replies are waiting."""
        if sum(map(len, self._replies)) < MOST_WAITING:
            self._replies.append(reply)
        self._wake.set()

    async def send(self) -> None:
        """Send all queued messages as fast as the browser reads, until the connection is closed."""
        with suppress(ConnectionClosed):
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._replies:
                    await self.connection.send(self._replies.popleft())
                while self._messages:
                    await self.connection.send(self._messages.pop(next(iter(self._messages))))
                if self._frame:
                    frame, self._frame = self._frame, b""
                    await self.connection.send(frame)

    def too_many(self) -> bool:
        """Count a message; return whether the browser exceeds `MESSAGES_PER_S`."""
        now = time.monotonic()
        self._allowed = min(BURST, self._allowed + (now - self._since) * MESSAGES_PER_S) - 1.0
        self._since = now
        return self._allowed < 0.0


class Server:
    """Serves the page of one network to several browsers.

    Args:
        settings: host, port and token.
        reader: messages from the network's process.
        writer: messages to the network's process.
    """

    def __init__(self, settings: Head, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._host, self._port = str(settings["host"]), int(settings["port"])
        self._secret = f"/{settings['token']}/".encode()
        self._reader, self._writer = reader, writer
        self._clients: dict[int, Client] = {}
        self._messages: dict[str, str] = {}
        self._number = 0
        style = html.style_sheets("player.css") + "\n" + (_FOLDER / "page.css").read_text("utf-8")
        self._files = {
            "": ("text/html", (_FOLDER / "page.html").read_bytes()),
            "page.css": ("text/css", style.encode()),
            **{name: ("text/javascript", (_FOLDER / name).read_bytes()) for name in ("graph.js", "page.js")},
        }

    async def run(self) -> None:
        """Serve until the network's process ends."""
        try:
            server = await serve(
                self._accept_browser,
                self._host,
                self._port,
                process_request=self._respond,
                compression=None,
                max_size=LONGEST_MESSAGE,
                max_queue=4,
                open_timeout=OPEN_S,
                close_timeout=1.0,
                server_header=None,
            )
        except (OSError, OverflowError) as error:
            self._tell({"error": str(error)})
            await self._writer.drain()
            return
        self._port = next(iter(server.sockets)).getsockname()[1]
        self._tell({"port": self._port})
        try:
            await self._listen()
        finally:
            server.close(close_connections=True)

    # to and from the network's process

    def _tell(self, head: Head) -> None:
        self._writer.write(packed(head))

    async def _listen(self) -> None:
        while True:
            try:
                head_size, body_size = SIZES.unpack(await self._reader.readexactly(SIZES.size))
                text = (await self._reader.readexactly(head_size)).decode()
                body = await self._reader.readexactly(body_size)
            except (asyncio.IncompleteReadError, ConnectionError):
                return
            head = json.loads(text)
            if "keep" in head:
                if head["fresh"]:
                    self._messages.clear()
                self._messages[head["keep"]] = text
                for client in self._clients.values():
                    client.keep(head["keep"], text, head["fresh"])
            elif "to" in head:
                if receiver := self._clients.get(head.pop("to")):
                    receiver.reply(packed(head, body) if body else json.dumps(head))
            else:
                frame = SIZES.pack(head_size, body_size) + text.encode() + body
                for client in self._clients.values():
                    client.frame(frame)
                if self._clients:
                    self._tell({"want": True, "new": False, "first": False})

    # to and from browsers

    def _respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the requested file, an error, or None to accept a WebSocket."""
        if not self._is_here(request.headers):
            return _response(HTTPStatus.FORBIDDEN)
        path = request.path.encode()
        begin, name = path[: len(self._secret)], path[len(self._secret) :].decode()
        if getattr(request, "method", "GET") != "GET" or not hmac.compare_digest(begin, self._secret):
            return _response(HTTPStatus.NOT_FOUND)
        if name == "socket":
            if request.headers.get_all("Origin") != [f"http://{request.headers['Host']}"]:  # not the page itself
                return _response(HTTPStatus.FORBIDDEN)
            return _response(HTTPStatus.SERVICE_UNAVAILABLE) if len(self._clients) >= MOST_CLIENTS else None
        if name not in self._files:
            return _response(HTTPStatus.NOT_FOUND)
        kind, content = self._files[name]
        return _response(HTTPStatus.OK, f"{kind}; charset=utf-8", content)

    def _is_here(self, headers: Headers) -> bool:
        """Return whether the header Host is this server's host, or an address.

        Any other name may come from a name server that an attacker controls (DNS rebinding).
        """
        hosts = headers.get_all("Host")
        name, _, port = hosts[0].rpartition(":") if len(hosts) == 1 else ("", "", "")
        return port == str(self._port) and (name in ("localhost", self._host) or _is_address(name.strip("[]")))

    async def _accept_browser(self, connection: ServerConnection) -> None:
        if len(self._clients) >= MOST_CLIENTS:
            await connection.close(1013, "too many browsers")
            return
        self._number += 1
        number, client = self._number, Client(connection, self._messages)
        self._tell({"want": True, "new": True, "first": not self._clients})
        self._clients[number] = client
        sending = asyncio.ensure_future(client.send())
        try:
            async for message in connection:
                if client.too_many():
                    await connection.close(1008, "too many messages")
                    return
                self._forward(number, client, message)
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            del self._clients[number]

    def _forward(self, number: int, client: Client, message: str | bytes) -> None:
        """Forward a request of a browser if it is a flat JSON object."""
        try:
            request = json.loads(message) if isinstance(message, str) else None
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict) or not all(isinstance(v, str | int | float | None) for v in request.values()):
            client.reply(json.dumps({"error": "expected an object of JSON with texts and numbers", "id": 0}))
        elif self._writer.transport.get_write_buffer_size() > WAITING:
            client.reply(json.dumps({"error": "the simulation is busy: try again", "id": request.get("id", 0)}))
        else:
            self._tell({"asked": request, "of": number})


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _response(status: HTTPStatus, kind: str = "text/plain", content: bytes = b"") -> Response:
    content = content or f"{status.phrase}\n".encode()
    length = {"Content-Type": kind, "Content-Length": str(len(content)), "Connection": "close"}
    return Response(status.value, status.phrase, Headers({**_HEADERS, **length}), content)


async def _serve(end: socket.socket) -> None:
    reader, writer = await asyncio.open_connection(sock=end)
    head, body = SIZES.unpack(await reader.readexactly(SIZES.size))
    settings: dict[str, Any] = json.loads(await reader.readexactly(head + body))
    await Server(settings, reader, writer).run()


def main() -> None:
    """Serve until the socket of the descriptor is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.disable()
    asyncio.run(_serve(socket.socket(fileno=int(sys.argv[1]))))


if __name__ == "__main__":
    main()
