"""scan_fusion without its node: the scanner of the simulated cell in, height maps out."""

from __future__ import annotations

import numpy as np

from waam_bridge.frames import Telemetry
from waam_msgs.msg import HeightMap
from waam_process.grid import GridSpec
from waam_scan.conversions import map_to_msg
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion_params import FusionParams
from waam_scan.stream.assembler import Assembler
from waam_scan.stream.poses import PoseTrack
from waam_scan.stream.profiles import ProfileBlock
from waam_scan.stream.session import LaidBeads, PreviousMap, Session, Surfaces
from waam_sim.plant import Profiles

from .machine import Machine

BATCH = 100  # profiles that are fused at once; maps do not depend on it


class ScanError(RuntimeError):
    """A scan gave no map; the text says why."""


class Scanning:
    """One scan at a time: `begin`, then time passes, then `finish`. `warnings` collects doubts about maps."""

    def __init__(self, params: FusionParams, machine: Machine) -> None:
        self.params, self.machine, self.plant = params, machine, machine.plant
        self.track = PoseTrack(max(2, int(params.telemetry_seconds * params.telemetry_rate)))
        self.warnings: list[str] = []
        self._lateral = np.asarray(self.plant.scanner.lateral, np.float32)
        self._session: Session | None = None
        self._surfaces = Surfaces()
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
        """Number of the scan. GridError when the grid is larger than allowed."""
        p = self.params
        job, last = self._last
        scan_id = last + 1 if job == job_id else 0
        fusion = Fusion(spec, p.mounting, p.fusion, 1)
        gap, earliest = round(p.max_gap * 1e9), self.machine.time_us * 1000
        assembler = Assembler(fusion, self.track, gap, p.max_waiting, earliest, p.intensity)
        self._session = Session(job_id, layer, scan_id, assembler, laid, self.machine.now)
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
        session.assembler.resolve()
        return session.assembler.waiting == 0

    def _hand_over(self) -> None:
        if self._session is None or not self._waiting:
            return
        times = np.concatenate([p.time_us for p in self._waiting]).astype(np.int64)
        z = np.concatenate([p.z for p in self._waiting])
        light = np.concatenate([p.intensity for p in self._waiting])
        self._forget()
        x = np.broadcast_to(self._lateral, z.shape)
        self._session.add(self._batches, ProfileBlock(times * 1000, x, z, light))
        self._batches += 1

    def _forget(self) -> None:
        self._waiting.clear()
        self._count = 0

    def _fuse(self, session: Session) -> HeightMap:
        fused = session.close()
        if fused.points_used == 0:
            raise ScanError(f'empty map: {session.assembler.why_empty()}')
        doubts = session.doubts(fused, self._surfaces.last, self.params.plausibility)
        width = session.width(fused, self._surfaces)
        if doubts:
            text = f'map {session.scan_id} is not plausible: {"; ".join(doubts)}'
            self.warnings.append(text)
        else:
            seen = PreviousMap(session.job_id, session.layer, fused.spec, fused.z)
            self._surfaces.add(seen)
        return map_to_msg(session, fused, doubts, width)
