"""Sends messages in a thread of its own, so that no mail server holds up a cell. Nothing here writes an address."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

from .events import Event
from .notify_settings import NotifyError, NotifySettings, Target, parse, without_secrets
from .rate import RateLimit

FILE = 'notify.yaml'
WAITING = 100  # messages in the queue at most; more are counted as lost
AGAIN_S = 5.0  # a message that was not taken is sent once more after
# libraries that log addresses, some of them when asked for debugging only
TALKATIVE = ('apprise', 'urllib3', 'requests', 'requests_oauthlib', 'oauthlib')
Send = Callable[[Target, str, str], bool]


def load(shop: Path) -> NotifySettings:
    """The settings of a shop; without a file nobody is told. Raises NotifyError."""
    file = shop / FILE
    try:
        if file.stat().st_mode & 0o077:
            raise NotifyError('others can read it (chmod 600)')
        return parse(file.read_text(encoding='utf-8'))
    except FileNotFoundError:
        return NotifySettings()
    except (OSError, UnicodeDecodeError) as e:
        raise NotifyError(f'{file}: {type(e).__name__}') from None
    except NotifyError as e:
        raise NotifyError(f'{file}: {e}') from None


def send(target: Target, title: str, text: str) -> bool:
    """One message by apprise; False when it was not taken. Never raises, never logs: errors would hold the address."""
    try:
        for name in TALKATIVE:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # their children inherit it
        import apprise

        service = apprise.Apprise()
        return bool(service.add(target.url)) and bool(service.notify(body=text, title=title))
    except Exception:
        return False


class Notifier:
    """`tell` hands an event over; `sent`, `failed`, `held` count; `problem` is for a person, '' when all is well."""

    def __init__(self, settings: NotifySettings, cell: str, send: Send = send) -> None:
        self.settings = settings
        self.sent = self.failed = 0
        self.problem = ''
        self._cell, self._send = cell, send
        self._limit = RateLimit(settings.limits)
        self._queue: queue.Queue[Event | None] = queue.Queue(WAITING)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name='notify', daemon=True)
        if settings.targets:
            self._thread.start()

    @property
    def held(self) -> int:
        """Held back by the limits since the last message."""
        return self._limit.held

    def tell(self, event: Event) -> bool:
        """Whether the message goes out: somebody wants it, and the limits allow it."""
        wanted = any(event.kind in t.events for t in self.settings.targets)
        if not wanted or not self._limit.allow(event.kind, event.about, time.monotonic()):
            return False
        try:
            self._queue.put_nowait(event)
        except queue.Full:
            self.failed += 1
            self.problem = f'{WAITING} messages wait already'
            return False
        return True

    def close(self, timeout: float = 2.0) -> None:
        """Sends what waits for at most `timeout` s."""
        self._over.set()
        if self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put_nowait(None)
            self._thread.join(timeout)

    def _run(self) -> None:
        while (event := self._queue.get()) is not None:
            held = self._limit.take_held()
            more = f' ({held} other messages were held back.)' if held else ''
            for target in self.settings.targets:
                if event.kind in target.events:
                    self._deliver(target, event, event.text + more)

    def _deliver(self, target: Target, event: Event, text: str) -> None:
        title = f'{self._cell}: {event.kind.replace("_", " ")}'
        text = without_secrets(text, self.settings.targets)
        good = self._send(target, title, text)
        if not good and not self._over.wait(AGAIN_S):
            good = self._send(target, title, text)
        if good:
            self.sent += 1
            self.problem = ''
        else:
            self.failed += 1
            self.problem = f'messages: target {target.name!r} did not take a message'
