"""Asks the supervisor of `waam up` to start again what has died or hangs: two files in the folder of the graph.

Whoever asks writes REQUEST with a word of its own; the supervisor takes it away, does it, and writes ANSWER with the
same word.
"""

from __future__ import annotations

import json
import secrets
import time
from pathlib import Path
from typing import Any

from .files import write_atomically

REQUEST, ANSWER = 'restart.request', 'restart.answer'
TAKEN_S = 3.0  # a supervisor takes a request within
DONE_S = 45.0  # and has done it within


class NoSupervisor(RuntimeError):
    """Nobody takes the request, or it took too long."""


def ask(run: Path, taken_s: float = TAKEN_S, done_s: float = DONE_S) -> list[str]:
    """What was started again, each with how it was found. Blocks. Raises NoSupervisor."""
    word, request, answer = secrets.token_hex(8), run / REQUEST, run / ANSWER
    try:
        answer.unlink(missing_ok=True)
        write_atomically(request, word)
    except OSError as e:
        raise NoSupervisor(f'no graph of waam up in {run}: {e.strerror}') from None
    begun = time.monotonic()
    while time.monotonic() - begun < done_s:
        time.sleep(0.05)
        if request.exists() and time.monotonic() - begun > taken_s:
            request.unlink(missing_ok=True)
            raise NoSupervisor(
                f'no supervisor takes the request (waam up has ended): start the cell again there, in {run}'
            )
        if (done := _read(answer)) and done.get('word') == word:
            return [str(line) for line in done['started']]
    raise NoSupervisor(f'the supervisor did not say within {done_s:.0f} s what it has started')


def _read(file: Path) -> dict[str, Any] | None:
    try:
        data = json.loads(file.read_text(encoding='utf-8'))
    except (OSError, ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) and isinstance(data.get('started'), list) else None


def take(run: Path) -> str | None:
    """The word of a request that waits, which is taken away; None = there is none. For the supervisor."""
    file = run / REQUEST
    if not file.exists():
        return None
    try:
        word = file.read_text(encoding='utf-8', errors='replace')[:100]
        file.unlink()
    except OSError:
        return None
    return word


def answer(run: Path, word: str, started: list[str]) -> None:
    """What was started again. OSError when the disk refuses."""
    write_atomically(run / ANSWER, json.dumps({'word': word, 'started': started}))
