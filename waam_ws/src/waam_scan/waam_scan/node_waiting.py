"""Awaiting without a thread, polling or a blocked executor: coroutines that advance in the callbacks they wait for."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from functools import partial
from typing import Any

from rclpy.task import Future

from waam_node.node import WaamNode


class Event:
    """An awaitable that is set once, from any callback."""

    def __init__(self) -> None:
        self._waiting: list[Callable[[], None]] = []
        self.is_set = False
        self.value: Any = None

    @classmethod
    def of(cls, future: Future) -> Event:
        """Set with the result of a client's future."""
        event = cls()
        future.add_done_callback(lambda f: event.set(f.result()))
        return event

    def set(self, value: Any = None) -> None:
        """What waits goes on at once, inside this call; a second call has no effect."""
        if self.is_set:
            return
        self.is_set, self.value = True, value
        waiting, self._waiting = self._waiting, []
        for resume in waiting:
            resume()

    def on_set(self, resume: Callable[[], None]) -> None:
        """`resume` is called by `set`; never when the event is set already."""
        self._waiting.append(resume)

    def __await__(self) -> Generator[Event, None, Any]:
        if not self.is_set:
            yield self
        return self.value


def start(
    coroutine: Coroutine, done: Callable[[Any], None], failed: Callable[[Exception], None]
) -> None:
    """Runs a coroutine that awaits `Event`s; at its end either `done` (with what it returns) or `failed` is called."""

    def step() -> None:
        try:
            event = coroutine.send(None)
        except StopIteration as end:
            done(end.value)
        except Exception as error:
            failed(error)
        else:
            event.on_set(step)

    step()


def after(node: WaamNode, seconds: float) -> Event:
    """An event that is set after `seconds` of steady time."""
    event = Event()

    def fire() -> None:
        node.destroy_timer(timer)
        event.set()

    timer = node.create_timer(seconds, fire, clock=node.steady)
    return event


def first(*events: Event) -> Event:
    """Set as soon as one of the events is, with its value."""
    either = Event()
    for event in events:
        if event.is_set:
            either.set(event.value)
        else:
            event.on_set(partial(_pass_on, event, either))
    return either


def _pass_on(event: Event, either: Event) -> None:
    either.set(event.value)
