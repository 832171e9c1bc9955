"""Where a stream comes from or goes to."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from neuro.core.errors import ModelError, unknown

SCHEMES = ("udp", "tcp")
CLOSED = "NEURO_STREAMS_CLOSED"
"""An environment variable: a process that has it, and those that it starts, open no stream."""


@dataclass(frozen=True, slots=True)
class Address:
    """A URL of a stream.

    Attributes:
        url: as given.
        scheme: udp or tcp.
        family: of its sockets.
        place: host and port, as sockets take them.
    """

    url: str
    scheme: str
    family: socket.AddressFamily
    place: Any

    def new_socket(self) -> socket.socket:
        """A socket of its kind."""
        return socket.socket(self.family, socket.SOCK_DGRAM if self.scheme == "udp" else socket.SOCK_STREAM)

    def bound(self, place: Any) -> str:
        """The URL with the port that a socket has got."""
        host = f"[{place[0]}]" if self.family == socket.AF_INET6 else place[0]
        return f"{self.scheme}://{host}:{place[1]}"

    def refused(self, error: OSError) -> ModelError:
        """What the system says of it."""
        low = "ports below 1024 are for administrators; 3333 is none of them"
        known = {
            errno.EADDRINUSE: ("another program listens there", "port 0 takes a free one"),
            errno.EACCES: ("this user may not use it", low if self.place[1] < 1024 else ""),
            errno.EADDRNOTAVAIL: ("no interface of this machine has the address", "0.0.0.0 is all of them"),
            errno.ECONNREFUSED: ("nobody listens there", "start the sender first"),
        }
        text, hint = known.get(error.errno or 0, (error.strerror or str(error) or type(error).__name__, ""))
        return ModelError(f"{self.url}: {text}", hint=hint)


def parsed(url: object) -> tuple[str, str, int]:
    """Scheme, host and port of a URL such as udp://127.0.0.1:3333 or tcp://[::1]:7777.

    Raises:
        ModelError: it is none.
    """
    expected = "expected udp://HOST:PORT or tcp://HOST:PORT, such as udp://127.0.0.1:3333"
    if not isinstance(url, str):
        raise ModelError(f"url = {url!r:.60}: {expected}")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    else:
        if parts.scheme and parts.scheme not in SCHEMES and "://" in url:
            raise unknown("kind of stream", parts.scheme, SCHEMES)
    if host is None or port is None or parts.path.strip("/") or parts.query or parts.fragment or parts.username:
        raise ModelError(f"url = {url!r:.80}: {expected}")
    return parts.scheme, host, port


def address(url: str) -> Address:
    """Look up the host of a URL.

    Raises:
        ModelError: it is none, or its host is not known.
    """
    scheme, host, port = parsed(url)
    if os.environ.get(CLOSED):
        raise ModelError(f"{url}: is not opened while a file is made again")
    kind = socket.SOCK_DGRAM if scheme == "udp" else socket.SOCK_STREAM
    try:
        family, _, _, _, place = socket.getaddrinfo(host, port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise ModelError(f"{url}: host '{host}' is not known ({getattr(error, 'strerror', '') or error})") from None
    return Address(url, scheme, family, place)


def format_for(scheme: str, format: object, known: Iterable[str]) -> str:
    """The format of a stream: by TCP only aedat4, by UDP one that is named.

    Raises:
        ModelError: there is no such format, or it does not come this way.
    """
    by_udp = tuple(known)
    names = ("aedat4",) if scheme == "tcp" else by_udp
    if format is None:
        if scheme == "tcp":
            return "aedat4"
        raise ModelError(f"format is missing: expected one of {', '.join(names)}")
    if not isinstance(format, str) or format not in names:
        if isinstance(format, str) and format in ("aedat4", *by_udp):
            other = "tcp" if scheme == "udp" else "udp"
            raise ModelError(f"format '{format}' comes by {other}://: found {scheme}://")
        raise unknown("format of a stream", format, names)
    return str(format)
