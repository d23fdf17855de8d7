"""scan_fusion without its node: the scanner of the simulated cell in, height maps out."""

from __future__ import annotations

import numpy as np

from waam_bridge.frames import Telemetry
from waam_msgs.msg import HeightMap
from waam_process.grid import GridSpec
from waam_scan.conversions import map_to_msg
from waam_scan.fusion_params import FusionParams
from waam_scan.map_maker import MapMaker
from waam_scan.stream.profiles import ProfileBlock
from waam_scan.stream.session import LaidBeads, Session
from waam_sim.plant import Profiles

from .machine import Machine

BATCH = 100  # profiles that are fused at once; maps do not depend on it


class ScanError(RuntimeError):
    """A scan gave no map; the text says why."""


class Scanning:
    """One scan at a time: `begin`, then time passes, then `finish`. `warnings` collects doubts about maps."""

    def __init__(self, params: FusionParams, machine: Machine) -> None:
        self.machine, self.plant = machine, machine.plant
        self._maker = MapMaker(params, threads=1)
        self.track = self._maker.track
        self.warnings: list[str] = []
        self._lateral = np.asarray(self.plant.scanner.lateral, np.float32)
        self._session: Session | None = None
        self._last: tuple[str, int] = ('', -1)
        self._waiting: list[Profiles] = []
        self._count = 0  # of profiles that wait
        self._batches = 0

    def on_frame(self, t: Telemetry) -> None:
        """Telemetry of the controller (us, um); kept only while a scan runs."""
        if self._session is not None:
            self.track.append(t.t_us * 1000, t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6)

    def on_profiles(self, profiles: Profiles) -> None:
        """Profiles of the simulated scanner; fused BATCH at a time."""
        self._waiting.append(profiles)
        self._count += len(profiles.time_us)
        if self._count >= BATCH:
            self._hand_over()

    def begin(self, job_id: str, layer: int, spec: GridSpec, laid: LaidBeads) -> int:
        """Number of the scan."""
        job, last = self._last
        scan_id = last + 1 if job == job_id else 0
        earliest = self.machine.time_us * 1000
        self._session = self._maker.begin(job_id, layer, scan_id, spec, earliest, laid)
        self._last = (job_id, scan_id)
        self.plant.scanning = True
        return scan_id

    def finish(self, scan_id: int, until: float) -> HeightMap:
        """The map of everything up to `until` (s). ScanError when there is none."""
        session = self._session
        if session is None or session.scan_id != scan_id:
            raise ScanError(f'scan {scan_id} is not running')
        session.until_ns = round(until * 1e9)
        self.plant.scanning = False
        self._hand_over()
        # do not wait for what cannot come; the last profiles need the telemetry after them
        self.machine.until(lambda: self._resolved(session), 0.1)
        self._session = None
        return self._fuse(session)

    def _resolved(self, session: Session) -> bool:
        session.resolve()
        return session.waiting == 0

    def _hand_over(self) -> None:
        if self._session is None or not self._waiting:
            return
        times = np.concatenate([p.time_us for p in self._waiting]).astype(np.int64)
        z = np.concatenate([p.z for p in self._waiting])
        self._forget()
        x = np.broadcast_to(self._lateral, z.shape)
        self._session.add_batch(self._batches, ProfileBlock(times * 1000, x, z))
        self._batches += 1

    def _forget(self) -> None:
        self._waiting.clear()
        self._count = 0

    def _fuse(self, session: Session) -> HeightMap:
        found = self._maker.finish(session)
        if found.empty:
            raise ScanError(found.doubts[0])
        if found.doubts:
            text = f'map {session.scan_id} is not plausible: {"; ".join(found.doubts)}'
            self.warnings.append(text)
        return map_to_msg(session, found)
