"""report.html of every job that has ended, made in a process of its own: callbacks and drawing never wait for it."""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from waam_node import job_folder

PATIENCE_S = 120.0  # the machine is disarmed and the record closed before report.json is written
GRACE_S = 6.0  # for the client that follows the job and writes the same page
LONGEST_S = 900.0  # of many layers on a busy machine
POLL_S = 0.2
Say = Callable[[str], None]


class ReportWriter:
    """`begin` and `end` return at once. say: where the page lies; warn: why there is none."""

    def __init__(self, say: Say, warn: Say, patience: float = PATIENCE_S) -> None:
        self.problem = self.last = ''
        self._say, self._warn, self._patience = say, warn, patience
        self._began: dict[Path, int] = {}  # ns of the wall clock, as the times of files
        self._ended: queue.SimpleQueue[Path] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='report', daemon=True)
        self._thread.start()

    def begin(self, folder: Path) -> None:
        """A job runs in this folder: a report.json that is older than now belongs to a run before a resume."""
        self._began[folder] = time.time_ns()

    def end(self, folder: Path) -> None:
        """The job of this folder has ended, report.json is there or comes soon."""
        self._ended.put(folder)

    def close(self, timeout: float = 5.0) -> None:
        """Gives up a page that is not finished; `waam report FOLDER` makes it later."""
        self._stop.set()
        self._thread.join(timeout)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                folder = self._ended.get(timeout=POLL_S)
            except queue.Empty:
                continue
            trouble = self._write(folder)
            self.problem = trouble and f'no report.html: {trouble}'
            if trouble:
                self._warn(f'{folder}: {self.problem}')

    def _write(self, folder: Path) -> str:
        """'' or what went wrong."""
        if folder in self._began:
            began = self._began.pop(folder)
            if not self._wait(lambda: changed_ns(folder / job_folder.REPORT) > began):
                return '' if self._stop.is_set() else 'the job wrote no report.json'
        elif not (folder / job_folder.REPORT).is_file():  # an old status of a job that is gone
            return ''
        if self._wait(lambda: not is_old(folder), GRACE_S):  # a client was quicker
            return ''
        return self._make(folder)

    def _make(self, folder: Path) -> str:
        command = [sys.executable, '-m', 'waam_view.report', str(folder)]
        env = {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
        with subprocess.Popen(
            command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as child:
            listener = threading.Thread(target=self._limit, args=(child,))
            listener.start()
            _, errors = child.communicate()
            listener.join()
        if child.returncode == 0:
            self.last = str(folder / job_folder.REPORT_PAGE)
            self._say(f'report: {self.last}')
            return ''
        if self._stop.is_set():
            return ''
        lines = errors.strip().splitlines()
        return lines[-1] if lines else f'the process ended with {child.returncode}'

    def _limit(self, child: subprocess.Popen) -> None:
        """Ends a child that takes too long or is no longer needed."""
        if not self._wait(lambda: child.poll() is not None, LONGEST_S):
            child.kill()

    def _wait(self, condition: Callable[[], bool], patience: float = 0.0) -> bool:
        """False when it did not come true in time, or the node ends."""
        end = time.monotonic() + (patience or self._patience)
        while not condition():
            if time.monotonic() > end or self._stop.wait(POLL_S):
                return False
        return True


def changed_ns(file: Path) -> int:
    """When a file was written, ns; 0 for one that is not there."""
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return 0


def is_old(folder: Path) -> bool:
    """report.html is missing or older than report.json."""
    page = changed_ns(folder / job_folder.REPORT_PAGE)
    return not page or page < changed_ns(folder / job_folder.REPORT)
