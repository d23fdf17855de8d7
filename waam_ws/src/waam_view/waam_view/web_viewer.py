"""The rerun binary as a child that serves its web viewer on 127.0.0.1 (the one in the SDK listens
on all interfaces)."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import urllib.parse
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def binary() -> Path:
    """The viewer itself: the `rerun` script is a wrapper whose end would leave it running."""
    import rerun_cli

    return Path(rerun_cli.__file__).parent / 'rerun'


def _die_with_parent() -> None:
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


class WebViewer:
    """Serves the viewer at `url`, showing `source`: the address of a rerun server or a recording
    file."""

    def __init__(self, source: str, web_port: int, data_port: int = 0) -> None:
        command = [str(binary()), source, '--serve-web', '--bind', '127.0.0.1']
        command += ['--web-viewer-port', str(web_port), '--port', str(data_port or 'auto')]
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
            preexec_fn=_die_with_parent,
        )
        shown = source if '://' in source else f'rerun+http://127.0.0.1:{data_port}/proxy'
        self.url = f'http://127.0.0.1:{web_port}/?url={urllib.parse.quote(shown, safe="")}'

    def wait(self) -> int:
        """Until the viewer ends. Returns its exit status."""
        return self._process.wait()

    def close(self) -> None:
        """Terminates the viewer; kills it when it has not ended after 3 s."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
