"""Who is connected: a bound on connections in all and per address, and on the time that one may take to ask.

A connection *waits* until its request has been admitted, and again after the answer. When there are too many, the one
that waits longest goes, first of the same address: so whoever asks at once always gets in, and half-open connections
only push out each other. Counting begins before TLS. Standard library only.
"""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import resource
import socket
import ssl
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

IN_ALL, PER_SOURCE = 192, 48  # connections; a page has up to seven
HEAD_S = 5.0  # for TLS and the head of a request
IDLE_S = 20.0  # between two requests
SWEEP_S = 0.25
BACKLOG = 1024
EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


def source_of(address: object) -> str:
    """Whom a connection counts for: the address, of IPv6 its first 64 bits, which one computer chooses from freely."""
    host = str(address[0]) if isinstance(address, tuple) and address else ''
    try:
        number = ipaddress.ip_address(host.partition('%')[0])
    except ValueError:
        return host
    if isinstance(number, ipaddress.IPv6Address):
        if number.ipv4_mapped:
            return str(number.ipv4_mapped)
        return str(ipaddress.ip_network((number, 64), strict=False))
    return str(number)


@dataclass(eq=False)
class Guest:
    """One connection. until: loop time at which it has to go, None while its request is being answered."""

    source: str
    socket: socket.socket
    until: float | None

    def turn_out(self) -> None:
        """Ends the connection; its transport notices and tidies up."""
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)


class _Door(asyncio.Protocol):
    """In front of the protocol of a connection, to notice its end."""

    def __init__(self, gate: Gate, guest: Guest, inner: asyncio.Protocol) -> None:
        self._gate, self._guest, self._inner = gate, guest, inner
        self.data_received = inner.data_received  # type: ignore[method-assign]
        self.eof_received = inner.eof_received  # type: ignore[method-assign]
        self.pause_writing = inner.pause_writing  # type: ignore[method-assign]
        self.resume_writing = inner.resume_writing  # type: ignore[method-assign]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """TLS is done, if there is any."""
        self._gate.guests[self._inner] = self._guest
        self._inner.connection_made(transport)

    def connection_lost(self, error: Exception | None) -> None:
        """The place is free."""
        self._gate.guests.pop(self._inner, None)
        self._gate.leave(self._guest)
        self._inner.connection_lost(error)


class Gate:
    """make: a new protocol for a connection. `serve` accepts until it is cancelled."""

    def __init__(
        self, make: Callable[[], asyncio.Protocol], tls: ssl.SSLContext | None = None
    ) -> None:
        self.make, self.tls = make, tls
        files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        self.most = IN_ALL if files < 0 else min(IN_ALL, files // 4)
        self.inside: dict[Guest, None] = {}  # in the order of arrival
        self.guests: dict[asyncio.Protocol, Guest] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self, listener: socket.socket) -> None:
        """Accepts connections; the listener is closed at the end."""
        loop = asyncio.get_running_loop()
        listener.setblocking(False)
        sweep = loop.create_task(self._sweep())
        try:
            while True:
                try:
                    connection, address = await loop.sock_accept(listener)
                except OSError as e:
                    if e.errno in EXHAUSTED and not self._push_out(list(self.inside)):
                        print(f'waam: connections: {e.strerror}', file=sys.stderr)
                        await asyncio.sleep(SWEEP_S)
                    continue
                guest = self._enter(connection, source_of(address), loop.time())
                if guest is None:
                    connection.close()
                    continue
                task = loop.create_task(self._welcome(guest))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
                await asyncio.sleep(0)  # those that were pushed out give their descriptors back
        finally:
            sweep.cancel()
            listener.close()
            for guest in list(self.inside):
                guest.turn_out()

    def _enter(self, connection: socket.socket, source: str, now: float) -> Guest | None:
        same = [g for g in self.inside if g.source == source]
        if len(same) >= PER_SOURCE and not self._push_out(same):
            return None
        if len(self.inside) >= self.most:
            counts: dict[str, list[Guest]] = {}
            for guest in self.inside:
                counts.setdefault(guest.source, []).append(guest)
            if not any(map(self._push_out, sorted(counts.values(), key=len, reverse=True))):
                return None
        guest = Guest(source, connection, now + HEAD_S)
        self.inside[guest] = None
        return guest

    def _push_out(self, some: list[Guest]) -> bool:
        """Turns out the one of these that waits and has to go first; False when none waits."""
        waiting = [g for g in some if g.until is not None]
        if not waiting:
            return False
        first = min(waiting, key=lambda g: g.until or 0.0)
        first.turn_out()
        self.leave(first)
        return True

    def leave(self, guest: Guest) -> None:
        """It counts no more."""
        self.inside.pop(guest, None)

    async def _welcome(self, guest: Guest) -> None:
        loop, patience = asyncio.get_running_loop(), HEAD_S if self.tls else None
        try:
            await loop.connect_accepted_socket(
                lambda: _Door(self, guest, self.make()),
                guest.socket,
                ssl=self.tls,
                ssl_handshake_timeout=patience,
                ssl_shutdown_timeout=1.0 if self.tls else None,
            )
        except (OSError, ssl.SSLError, TimeoutError):
            self.leave(guest)
            guest.socket.close()

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_S)
            now = asyncio.get_running_loop().time()
            for guest in [g for g in self.inside if g.until is not None and now > g.until]:
                guest.turn_out()
                self.leave(guest)

    # ---- what a request tells

    def busy(self, protocol: object) -> None:
        """The request of this connection is admitted: it stays until it has its answer."""
        guest = self.guests.get(protocol)  # type: ignore[call-overload]
        if guest:
            guest.until = None

    def idle(self, protocol: object) -> None:
        """It has its answer. One that was never admitted has no more time than before."""
        guest = self.guests.get(protocol)  # type: ignore[call-overload]
        if guest and guest.until is None:
            guest.until = asyncio.get_running_loop().time() + IDLE_S
