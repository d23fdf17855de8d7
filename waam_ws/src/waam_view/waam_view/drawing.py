"""The drawing thread: owns the scene and its recordings, so that a stalled viewer or disk never
touches a callback."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import rerun as rr

from waam_node import job_folder

from . import blueprint as bp
from .job_data import shaft_in
from .mailbox import Mailbox
from .scene import MapData, Sample, Scene
from .web_viewer import WebViewer
from .worst_places import LayerError, error_after

BATCH_S = 0.2  # telemetry is drawn in batches of this much wall time
AFTER_JOB_S = 2.0  # what arrives this long after the end of a job still goes into its file
WINDOW_S = 120.0  # of ROS time that live plots show
SERVER_MEMORY = '96MB'  # for viewers that connect late; the whole job is in job.rrd
KEEP_EXPECTED = 3  # scans that wait for their file
Draw = Callable[[Scene], None]


class Drawing:
    """Everything here returns at once; drawing happens in the thread. port, web_port: 0 = none."""

    def __init__(self, scene: Scene, port: int, web_port: int) -> None:
        self.mailbox = Mailbox()
        self.problem = self.url = self.file = ''
        self.drawn, self.longest_s = 0, 0.0
        self._scene = scene
        self._ports = (port, web_port)
        self._web: WebViewer | None = None
        self._file_ends = 0.0
        self._folder: Path | None = None
        self._expected: list[tuple[int, MapData]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='drawing', daemon=True)
        self._thread.start()

    def put(self, draw: Draw) -> None:
        """Draws in order; the oldest are dropped when the thread is far behind."""
        self.mailbox.put(draw)

    def newest(self, key: str, draw: Draw) -> None:
        """For maps: only the newest of a key is drawn when the thread is behind."""
        self.mailbox.replace(key, draw)

    def telemetry(self, sample: Sample) -> None:
        """As `put`, for one frame."""
        self.mailbox.put(sample)

    def start_job(self, folder: Path) -> None:
        """A job begins in this folder; its job.rrd is kept there."""
        self.mailbox.put(lambda scene: self._begin_job(scene, folder))

    def expect_error(self, layer: int, measured: Callable[[], MapData]) -> None:
        """The surface was measured after `layer`; its error is drawn when the job has written what it wants there."""
        self.mailbox.put(lambda _: self._expected.append((layer, measured())))

    def end_job(self) -> None:
        """The file is kept open a while for what still comes, then closed."""
        self.mailbox.put(lambda _: self._end_later())

    def close(self, timeout: float = 5.0) -> None:
        """Draws what waits and closes the file."""
        self._stop.set()
        self._thread.join(timeout)
        if self._web is not None:
            self._web.close()

    def _run(self) -> None:
        self._guard(lambda _: self._serve())
        while not self._stop.is_set():
            self._turn()
            self._stop.wait(BATCH_S)
        self._turn()
        self._guard(lambda scene: scene.close())

    def _turn(self) -> None:
        """One batch: telemetry since the last one in a single call, maps, texts; in the order they
        came."""
        items, newest = self.mailbox.take(0.0)
        samples = [i for i in items if isinstance(i, Sample)]
        for draw in (i for i in items if not isinstance(i, Sample)):
            self._guard(draw)
        for draw in newest:
            self._guard(draw)
        if samples:
            self._guard(lambda scene: scene.telemetry(samples))
        self._guard(self._draw_errors)
        if self._file_ends and time.monotonic() > self._file_ends:
            self._file_ends, self.file = 0.0, ''
            self._guard(lambda scene: scene.remove('file'))

    def _guard(self, draw: Draw) -> None:
        """Reports and skips a drawing that fails."""
        start = time.monotonic()
        try:
            draw(self._scene)
            self.drawn += 1
        except Exception as e:  # whatever the viewer library raises
            self.problem = f'{type(e).__name__}: {e}'
        self.longest_s = max(self.longest_s, time.monotonic() - start)

    def _serve(self) -> None:
        port, web_port = self._ports
        if not port and not web_port:
            return
        port = port or free_port()  # the web page needs a server to show
        if not port_is_free(port):
            self.problem = f'port {port} is in use: no live view'
            return
        live = rr.RecordingStream('waam', recording_id='live')
        sink = rr.GrpcServerSink(bind_ip='127.0.0.1', port=port, server_memory_limit=SERVER_MEMORY)
        live.set_sinks(sink, default_blueprint=bp.blueprint(self._scene.error_range, WINDOW_S))
        self._scene.add('live', live)
        self.url = f'rerun+http://127.0.0.1:{port}/proxy'
        if web_port:
            self._web = WebViewer(self.url, web_port)
            self.url = self._web.url

    def _begin_job(self, scene: Scene, folder: Path) -> None:
        self._folder, self._file_ends = folder, 0.0
        self._expected.clear()
        scene.new_job()
        scene.shaft = shaft_in(folder)
        if not folder.is_dir():
            raise FileNotFoundError(f'{folder} does not exist: no job.rrd')
        self.file = str(free_name(folder))
        scene.record(Path(self.file))

    def _draw_errors(self, scene: Scene) -> None:
        """Errors of scans whose target is in the job's folder by now; a half-written file is tried again."""
        waiting, self._expected = self._expected[-KEEP_EXPECTED:], []
        for layer, measured in waiting:
            after = self._error(layer, measured)
            if after is None:
                self._expected.append((layer, measured))
            else:
                scene.error_map(measured, after)

    def _error(self, layer: int, measured: MapData) -> LayerError | None:
        if self._folder is None:
            return None
        return error_after(self._folder, layer, measured.spec, measured.z)

    def _end_later(self) -> None:
        self._file_ends = time.monotonic() + AFTER_JOB_S


def free_name(folder: Path) -> Path:
    """job.rrd, or job_2.rrd ... when a resumed job finds one there."""
    number = 1
    while (folder / job_folder.viewer_recording(number)).exists():
        number += 1
    return folder / job_folder.viewer_recording(number)


def free_port() -> int:
    """A port of 127.0.0.1 that nobody listens on now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.bind(('127.0.0.1', 0))
        return s.getsockname()[1]


def port_is_free(port: int) -> bool:
    """Whether the TCP port can be bound on 127.0.0.1."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind(('127.0.0.1', port))
        except OSError:
            return False
    return True
