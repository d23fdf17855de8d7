"""The operator of `waam commission` behind a program that shows questions and hands over answers: JSON, a line each."""

from __future__ import annotations

import json
import math
import queue
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from .commission_visit import HAND_S, Question


class Lines:
    """`ask` and `do` of an operator, and `say`. Out, on stdout:

    {"say": text, "book": what `told` gives}: how it goes
    {"ask": id, "text", "words", "low", "high", "unit", "count", "file", "wrong"}: a question; low and high are null
    where there is none, wrong says why the answer before was none
    {"do": id, "text", "wait", "seconds"}: what is to be done by hand; wait: until a line says that it is done, else it
    is measured for so many seconds

    In, on stdin: {"answer": text}. The end of the input is Ctrl-C: nobody is there any more."""

    def __init__(self, told: Callable[[], dict[str, Any]]) -> None:
        self._told = told
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._main = threading.get_ident()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the program has set
        threading.Thread(target=self._listen, name='answers', daemon=True).start()

    def _listen(self) -> None:
        for line in sys.stdin:
            self._answers.put(_answer(line))
        signal.pthread_kill(self._main, signal.SIGINT)

    def say(self, text: str) -> None:
        """How it goes, and how the book stands."""
        _out(say=text.strip(), book=self._told())

    def ask(self, question: Question) -> str:
        """Asks again until it is an answer."""
        wrong = ''
        while True:
            low, high = (v if math.isfinite(v) else None for v in (question.low, question.high))
            _out(
                ask=question.id, text=question.text, words=question.words, low=low, high=high, unit=question.unit,
                count=question.count, file=question.file, wrong=wrong and f'wanted is {wrong}',
            )  # fmt: skip
            answer = question.cleaned(self._answers.get())
            if not (wrong := question.wrong(answer)):
                return answer

    def do(self, action: str, text: str, wait: bool) -> None:
        """wait: until a line says that it is done."""
        _out(do=action, text=text, wait=wait, seconds=HAND_S)
        if wait:
            self._answers.get()


def _answer(line: str) -> str:
    """What it says; '' for a line that says nothing, which no question takes."""
    try:
        return str(json.loads(line)['answer'])
    except (ValueError, KeyError, TypeError):
        return ''


def _out(**message: Any) -> None:
    print(json.dumps(message), flush=True)
