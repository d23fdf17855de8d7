"""The node scan_fusion: profiles and telemetry in, height maps out. The ideas are in `stream` and `fusion`."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from sensor_msgs.msg import Image, LaserScan, PointCloud2
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

import waam_node.node
from waam_msgs.msg import Anomaly, HeightMap, JobStatus, ProfileBatch, Telemetry
from waam_msgs.srv import BeginScan, FinishScan
from waam_node import job_folder
from waam_node.cdr import read_pose
from waam_node.conversions import image_to_msg, nanoseconds
from waam_node.deferred import Deferred, create_deferred_service
from waam_node.node import WaamNode
from waam_node.qos import LATCHED, PROFILES, SENSOR, TELEMETRY, subscribe_to_driver
from waam_process.grid import GridError

from .conversions import (
    answer,
    block_from_cloud,
    block_from_scan,
    checked_grid,
    laid_beads,
    map_to_msg,
    mounting_to_msg,
)
from .fusion import height_map as fusion
from .fusion_params import FusionParams
from .map_maker import MapMaker
from .node_monitor import FusionMonitor
from .node_waiting import Event, after, first, start
from .stream.profiles import ProfileBlock, read_batch
from .stream.session import EndWatch, Session

RAW_KEPT = 500  # telemetry frames that are kept unread while no scan runs
ENDED = (JobStatus.IDLE, JobStatus.DONE, JobStatus.FAILED, JobStatus.ABORTED)
CLOCK_GRAIN_NS = 100_000_000  # /clock comes at 20 Hz of simulated time
ANSWER_S = 5.0  # steady time that the scanner may take to obey
# steady time: a finishing scan ends after so long without news, and gives up after so long although some still come
QUIET_S, GIVE_UP_S = 1.0, 30.0


class ScanFusion(WaamNode):
    """The node; services ~/begin and ~/finish, topics as in docs/interfaces.md."""

    def __init__(self) -> None:
        super().__init__('scan_fusion', FusionParams)
        p = self.params
        self._maker = MapMaker(p)
        self._track = self._maker.track
        self._raw: deque[bytes] = deque(maxlen=RAW_KEPT)
        self._session: Session | None = None  # the scan that runs
        self._beginning = False
        self._complete = Event()
        self._ended_job = ''  # it gets no scan any more, however late it asks
        self._last_scan: tuple[str, int] = ('', -1)
        self._last_batch = time.monotonic()
        fusion.warm_up()
        self._monitor = FusionMonitor(self, self._track)
        self._scanner = self.create_client(SetBool, 'scanner/enable')
        self._switched = False  # by that service; without it the scanner always measures
        self._maps = self.create_publisher(HeightMap, 'height_map', LATCHED)
        self._static = self.create_publisher(TFMessage, '/tf_static', LATCHED)
        scanner = mounting_to_msg(self._maker.mounting, self.get_clock().now().to_msg())
        self._static.publish(TFMessage(transforms=[scanner]))
        self._images = self.create_publisher(Image, 'height_image', LATCHED)
        self.create_subscription(Telemetry, 'telemetry', self._on_telemetry, TELEMETRY, raw=True)
        self.create_subscription(JobStatus, 'job_status', self._on_job, LATCHED)
        # batches are taken as they come over the wire: a message object would be two more copies of a megabyte
        subscribe_to_driver(self, ProfileBatch, 'profiles', self._on_profiles, PROFILES.depth, True)
        subscribe_to_driver(self, PointCloud2, p.points_topic, self._on_points, SENSOR.depth)
        subscribe_to_driver(self, LaserScan, p.scan_topic, self._on_scan, SENSOR.depth)
        self._drivers = 0  # messages of drivers: they carry no number; what is lost shows as a pause between stamps
        for kind, name, work in (
            (BeginScan, '~/begin', self._begin),
            (FinishScan, '~/finish', self._finish),
        ):
            create_deferred_service(self, kind, name, partial(self._serve, work))
        self.create_timer(1.0, lambda: self._monitor.report(self._session), clock=self.steady)
        # The first line that a process logs takes some 50 ms: not in the middle of the first scan.
        self.get_logger().info(f'ready, {p.threads} threads')

    def _on_telemetry(self, data: bytes) -> None:
        """Up to 1500 times a second of wall time: nothing is read before a profile needs it."""
        self._monitor.count['telemetry'] += 1
        self._raw.append(data)
        session = self._session
        if session and session.closing:
            self._read_telemetry()
            session.resolve()
            if session.complete:
                self._complete.set()
        elif session and len(self._raw) >= RAW_KEPT // 2:
            self._read_telemetry()

    def _on_job(self, status: JobStatus) -> None:
        """A scan does not outlive its job, whose request may have been given up before its answer came."""
        self._ended_job = status.job_id if status.state in ENDED else ''
        session = self._session
        if session is None or session.closing or status.state not in ENDED:
            return
        self.get_logger().warning(f'scan {session.scan_id}: its job has ended, scanner off')
        self._session = None
        self._scanner_off()

    def _scanner_off(self) -> None:
        def done(trouble: str) -> None:
            if trouble:
                self.get_logger().warning(f'scanner not switched off: {trouble}')

        start(self._switch(False), done, lambda e: done(str(e)))

    def _read_telemetry(self) -> None:
        while self._raw:
            self._track.append(*read_pose(self._raw.popleft()))

    def _on_profiles(self, data: bytes) -> None:
        self._on_batch(lambda: read_batch(data))

    def _on_points(self, msg: PointCloud2) -> None:
        p = self.params
        period = round(p.points_period * 1e9)
        self._on_driver(p.points_topic, msg, lambda: block_from_cloud(msg, p.points_down, period))

    def _on_scan(self, msg: LaserScan) -> None:
        self._on_driver(self.params.scan_topic, msg, lambda: block_from_scan(msg))

    def _on_driver(self, topic: str, msg: Any, make: Callable[[], ProfileBlock]) -> None:
        number, frame, wanted = self._drivers, msg.header.frame_id, self.params.scanner_frame
        if frame == wanted:
            self._drivers += 1
            self._on_batch(lambda: (number, make()))
        elif self._session:  # another device: it does not count against the map
            self._refuse(f"`{topic}` is in frame '{frame}', not '{wanted}' (scanner_frame)")

    def _refuse(self, why: str) -> None:
        session = self._session
        if session:
            session.refusal = why
            self._monitor.count['refused_batches'] += 1
            self._monitor.anomaly(f'profiles refused: {why}', Anomaly.WARNING, session)

    def _on_batch(self, make: Callable[[], tuple[int, ProfileBlock]]) -> None:
        """make: gives number and profiles, or raises ValueError."""
        self._monitor.count['batches'] += 1
        session = self._session
        if session is None:
            self._monitor.count['idle_batches'] += 1
            return
        try:
            sequence, block = make()
        except ValueError as error:
            session.refused += 1
            self._refuse(str(error))
            return
        self._read_telemetry()
        if self._switched or not session.is_past(block):
            self._last_batch = time.monotonic()
            session.add_batch(sequence, block)
        if session.complete:
            self._complete.set()
        else:
            session.refresh(self._last_batch)

    def _serve(self, work: Callable, request: Any, response: Any) -> Deferred:
        """Runs a coroutine service; its answer is sent when it returns."""
        later = Deferred()
        start(
            work(request, response), later.answer, lambda e: later.answer(self._failed(e, response))
        )
        return later

    async def _begin(
        self, request: BeginScan.Request, response: BeginScan.Response
    ) -> BeginScan.Response:
        if busy := self._busy(request.job_id):
            return answer(response, BeginScan.Response.BUSY, busy)
        try:
            session = self._new_session(request)
        except GridError as error:
            return answer(response, BeginScan.Response.BAD_GRID, str(error))
        if self._session is not None:
            self.get_logger().warning(f'scan {self._session.scan_id} was never finished')
        self._session, self._beginning = session, True
        trouble = await self._scanner_on(session)
        self._beginning = False
        if self._session is not session:
            trouble = trouble or 'the job has ended'
        if trouble:
            self._session = None
            self._scanner_off()  # it may have obeyed too late
            return answer(response, BeginScan.Response.NO_SCANNER, trouble)
        self._last_scan = (request.job_id, session.scan_id)
        response.scan_id = session.scan_id
        return answer(
            response, BeginScan.Response.OK, f'scan {session.scan_id}, layer {session.layer}'
        )

    def _busy(self, job_id: str) -> str:
        """Why no scan may begin now. One that was begun and left behind (its job ended) is given up."""
        if self._ended_job and job_folder.job_of(job_id) == self._ended_job:
            return f'job {self._ended_job} has ended'
        running = self._session
        if self._beginning or (running and running.closing):
            return 'another begin or finish is in progress'
        return ''

    def _new_session(self, request: BeginScan.Request) -> Session:
        spec = checked_grid(request.grid)
        earliest = self.get_clock().now().nanoseconds - CLOCK_GRAIN_NS
        job, last = self._last_scan
        scan_id = last + 1 if job == request.job_id else 0
        asked = request.job_id, request.layer, scan_id, spec, earliest
        return self._maker.begin(*asked, laid_beads(request), request.keep)

    async def _scanner_on(self, session: Session) -> str:
        """Returns '' when it measures, else what is wrong: by the service where it is there, else one that always
        measures must be heard."""
        client, wait = self._scanner, self.params.scanner_wait
        end, self._switched = time.monotonic() + wait, False
        while not client.service_is_ready():
            if session.fresh:
                return ''
            if time.monotonic() > end:
                why = session.refusal or ', '.join(session.counts.reasons())
                return (
                    f'no scanner: nothing comes on `points`, `profiles` or `scan`{why and f" ({why})"}, and service '
                    f'{client.srv_name} is not there (waited {wait:.1f} s)'
                )
            await after(self, 0.02)
        self._switched = True
        return await self._switch(True)

    async def _switch(self, on: bool) -> str:
        """Returns '' when the scanner obeyed or always measures, else what is wrong."""
        client = self._scanner
        name = client.srv_name
        if not self._switched:
            return ''
        if not client.service_is_ready():
            return f'service {name} is not there'
        future = client.call_async(SetBool.Request(data=on))
        obeyed = await first(Event.of(future), after(self, ANSWER_S))
        if obeyed is None:
            client.remove_pending_request(future)
            return f'no scanner: service {name} did not answer within {ANSWER_S:.1f} s'
        return '' if obeyed.success else f'the scanner refused: {obeyed.message}'

    async def _finish(
        self, request: FinishScan.Request, response: FinishScan.Response
    ) -> FinishScan.Response:
        session = self._session
        idle = session is None or session.closing or self._beginning
        if session is None or idle or session.scan_id != request.scan_id:
            return answer(
                response, FinishScan.Response.NO_SCAN, f'scan {request.scan_id} is not running'
            )
        session.until_ns, self._complete = nanoseconds(request.until), Event()
        # what is processed now need not wait for the last batch
        session.refresh(time.monotonic(), 0.0)
        try:
            if trouble := await self._switch(False):
                session.remarks.append(f'scanner not switched off: {trouble}')
            if not await self._everything(session):
                why = ', '.join(session.counts.reasons())
                text = f'the end of the scan was not reached in {GIVE_UP_S:.0f} s'
                text += why and f': {why}'
                self._monitor.no_map(text, session)
                return answer(response, FinishScan.Response.TIMEOUT, text)
            return self._fuse(session, response)
        finally:
            self._session = None

    async def _everything(self, session: Session) -> bool:
        """True when everything has arrived or nothing more comes; False when it would never end."""
        self._read_telemetry()
        session.resolve()
        now = time.monotonic()
        end, until = now + GIVE_UP_S, session.until_ns
        watch = EndWatch(until, QUIET_S, end, now, self._track.newest_ns)
        while not session.complete:
            now = time.monotonic()
            if watch.gives_up(now):
                return False
            if watch.is_quiet(now, self._track.newest_ns, self._last_batch):
                session.remarks.append(f'nothing new for {QUIET_S:.1f} s before its end')
                return True
            # an event that is set would never wait: 'complete' ends when another batch comes
            self._complete = Event()
            await first(after(self, 0.1), self._complete)
        return True

    def _fuse(self, session: Session, response: FinishScan.Response) -> FinishScan.Response:
        self._read_telemetry()
        found = self._maker.finish(session)
        if found.empty:
            self._monitor.no_map(found.doubts[0], session)
            return answer(response, FinishScan.Response.EMPTY, found.doubts[0])
        response.map = map_to_msg(session, found)
        self._maps.publish(response.map)
        self._images.publish(image_to_msg(found.fused.z, response.map.header))
        self._monitor.new_map(session, found, time.monotonic() - self._last_batch)
        return answer(response, FinishScan.Response.OK, '; '.join(response.map.reasons))

    def _failed(self, error: Exception, response: Any) -> Any:
        """A defect of this node: it is logged, and the caller gets an answer."""
        self.get_logger().error(''.join(traceback.format_exception(error)))
        self._session, self._beginning = None, False
        finish = isinstance(response, FinishScan.Response)
        code = FinishScan.Response.TIMEOUT if finish else BeginScan.Response.BUSY
        return answer(response, code, f'internal error of scan_fusion: {error}')


def main() -> None:
    waam_node.node.main(ScanFusion)
