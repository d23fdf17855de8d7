"""`waam commission` as a process of the panel: what it asks waits until somebody answers, whoever looks at it. No ROS.

What the lines mean stands in `waam_bringup.commission_lines`; here they are handed on. The panel is its only reader:
when the panel ends, so does the run, as by Ctrl-C.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import signal
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE
from collections import deque
from typing import Any

from .operations import Refused

KEPT, SHOWN, LONGEST = (
    60,
    8,
    300,
)  # lines of a run, of them in a frame of the stream; letters of one
FRESH_S = 10.0  # that what was read of the book counts, for pages that ask again
LOOK_S = 30.0
LINE = 1 << 20  # bytes that one may have
ERROR = 'waam: error: '


class Commissioning:
    """One run at a time. `asked`: the question or order that waits, with its number; `book`: as it was told last,
    None = not yet; `ended`: how the last run ended, '' = it runs, or none was."""

    def __init__(self, words: tuple[str, ...] = ()) -> None:
        """words: of Python, which commission this cell; () = nothing does."""
        self._words = words
        self._child: asyncio.subprocess.Process | None = None
        self._following: asyncio.Task[None] | None = None
        self._looking = asyncio.Lock()
        self._read = 0.0  # steady time of the last look
        self.running, self.ended = False, ''
        self.asked: dict[str, Any] | None = None
        self.book: dict[str, Any] | None = None
        self.version = 0
        # of the last question: no page that was open before this panel answers one of it
        self._number = secrets.randbelow(1 << 30)
        self._stopped = False  # before its process was there
        self.lines: deque[str] = deque(maxlen=KEPT)

    def shown(self) -> dict[str, Any]:
        """For the stream. version: of the book, which pages ask for by itself."""
        at = self.book['at'] if self.book else ''
        return {
            'running': self.running, 'at': at, 'asked': self.asked, 'ended': self.ended, 'version': self.version,
            'lines': list(self.lines)[-SHOWN:],
        }  # fmt: skip

    # ---- a run

    async def start(self, step: str) -> None:
        """Of one step, '' = all that are due. Refused while one runs."""
        if self.running:
            raise Refused('the commissioning runs already')
        self._check()
        self.running, self.ended, self._stopped = True, '', False
        self.lines.clear()
        try:
            self._child = await self._spawn('--json', *(['--step', step] if step else []))
        except OSError as e:
            self.running = False
            raise Refused(f'the commissioning cannot be started: {e}') from None
        self._following = asyncio.create_task(self._follow(self._child))
        if self._stopped:
            self.end()

    def question(self, number: object) -> dict[str, Any]:
        """What is asked under this number. Refused for another one: the page was old."""
        if self.asked is None or not isinstance(number, int) or self.asked['number'] != number:
            raise Refused('that is not asked any more; look at what is asked now')
        return self.asked

    def answer(self, number: int, text: str) -> None:
        """To what is asked under this number; refused as `question`."""
        self.question(number)
        assert self._child and self._child.stdin
        self.asked = None
        self._child.stdin.write(json.dumps({'answer': text}).encode() + b'\n')

    def end(self) -> None:
        """As Ctrl-C: the machine is stopped where the step moves it. Nothing when none runs."""
        self._stopped = True
        if self._child and self._child.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._child.send_signal(signal.SIGINT)

    async def _follow(self, child: asyncio.subprocess.Process) -> None:
        """Until it ends, whatever it says."""
        try:
            await asyncio.gather(
                self._hear(child.stdout, self._take), self._hear(child.stderr, self._note)
            )
            self.ended = self._last_words(await child.wait())
        except (ValueError, LookupError, TypeError) as e:  # such as a line that is too long
            self.ended = f'what it says cannot be read: {e!r}'
            self.end()
            await child.wait()
        finally:
            self.running, self.asked, self._child = False, None, None

    async def _hear(self, stream: asyncio.StreamReader | None, take: Any) -> None:
        assert stream is not None
        while line := await stream.readline():
            take(line.decode(errors='replace').strip())

    def _take(self, line: str) -> None:
        try:
            said = json.loads(line)
        except ValueError:
            said = None
        if not isinstance(said, dict):
            self._note(line)
        elif 'say' in said:
            self.asked = None
            self._note(str(said['say']))
            self._learn(said['book'])
        else:
            self._number += 1
            self.asked = said | {'number': self._number}

    def _note(self, line: str) -> None:
        if line:
            self.lines.append(line[:LONGEST])

    def _last_words(self, status: int) -> str:
        if status == 0:
            return 'done'
        last = self.lines[-1] if self.lines else f'ended with {status}'
        # a Python that is interrupted while it begins ends with 1
        interrupted = self._stopped and last == KeyboardInterrupt.__name__
        if interrupted or status in (130, -signal.SIGINT):
            return 'ended by hand; the step that ran has found nothing'
        return last.removeprefix(ERROR)

    # ---- the book

    def _learn(self, book: dict[str, Any]) -> None:
        if book != self.book:
            self.book, self.version = book, self.version + 1
        self._read = time.monotonic()

    async def look(self, busy: bool = False) -> dict[str, Any]:
        """The book as it is on the disk; while it runs, as it was told last, and where the cell is busy if there is
        one. Refused with the reason why not."""
        async with self._looking:
            old = not busy and time.monotonic() - self._read > FRESH_S
            if (old or self.book is None) and not self.running:
                self._check()
                self._learn(await self._ask())
        if self.book is None:
            raise Refused('the commissioning begins')
        return self.book

    async def _ask(self) -> dict[str, Any]:
        child = await self._spawn('--list', '--json')
        try:
            out, errors = await asyncio.wait_for(child.communicate(), LOOK_S)
            return json.loads(out)
        except TimeoutError:
            child.kill()
            raise Refused(f'no answer within {LOOK_S:g} s') from None
        except ValueError:
            words = errors.decode(errors='replace').strip().splitlines() or ['it says nothing']
            raise Refused(words[-1].removeprefix(ERROR)) from None

    def _check(self) -> None:
        if not self._words:
            raise Refused(
                'this page does not know how (parameter commission): waam commission NAME on the command line'
            )

    async def _spawn(self, *more: str) -> asyncio.subprocess.Process:
        looks = '--list' in more
        words = [*(('nice', '-n', '10') if looks else ()), sys.executable, *self._words, *more]
        return await asyncio.create_subprocess_exec(
            *words, stdin=DEVNULL if looks else PIPE, stdout=PIPE, stderr=PIPE, limit=LINE
        )
