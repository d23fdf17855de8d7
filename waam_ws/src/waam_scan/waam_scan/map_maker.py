"""Scans of one scanner, one after the other, to height maps: what the node, the laboratory and the replay share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridError, GridSpec

from .bead_width import BeadWidth, bead_width
from .fusion.height_map import FusedMap, Fusion
from .fusion_params import FusionParams
from .stream.poses import PoseTrack
from .stream.session import LaidBeads, PreviousMap, Session

TRACK_FRAMES = 6000  # of telemetry that poses are looked up in: a minute at 100 Hz


@dataclass(frozen=True)
class ScanMap:
    """doubts: why the map should not be trusted; none = plausible."""

    fused: FusedMap
    doubts: list[str]
    width: BeadWidth

    @property
    def empty(self) -> bool:
        """Nothing was seen; the doubt says why."""
        return self.fused.points_used == 0


class MapMaker:
    """`begin` a session, feed it, `finish` it. Poses go into `track`."""

    def __init__(self, params: FusionParams, threads: int | None = None) -> None:
        self.params, self.mounting = params, params.mounting
        self.track = PoseTrack(TRACK_FRAMES)
        self._threads = params.threads if threads is None else threads
        self._kept: Session | None = None  # the last one that gave a map
        self._believed: list[
            PreviousMap
        ] = []  # the newest one, and before it that of the layer below

    def begin(
        self,
        job_id: str,
        layer: int,
        scan_id: int,
        spec: GridSpec,
        earliest_ns: int,
        laid: LaidBeads = LaidBeads(),
        keep: bool = False,
    ) -> Session:
        """A session with an empty map; keep: with that of the last one. GridError when that is of another job or
        grid. earliest_ns: older profiles belong to another surface."""
        p = self.params
        fusion = Fusion(spec, self.mounting, p.fusion, self._threads)
        if keep and self._kept:
            if (self._kept.job_id, self._kept.spec) != (job_id, spec):
                raise GridError('keep: the map that is there is of another job or grid')
            fusion = self._kept.fusion
        return Session(
            fusion, self.track, not_before_ns=earliest_ns, job_id=job_id, layer=layer,
            scan_id=scan_id, laid=laid,
        )  # fmt: skip

    def finish(self, session: Session) -> ScanMap:
        """The map of a session; without doubts it is believed."""
        fused = session.close()
        if fused.points_used == 0:
            return ScanMap(fused, [f'empty map: {session.why_empty()}'], BeadWidth())
        last = self._believed[-1] if self._believed else None
        doubts = session.doubts(fused, last, self.params.plausibility)
        found = ScanMap(fused, doubts, self._width(session, fused))
        self._kept = session
        if not doubts:
            self.believe(PreviousMap(session.job_id, session.layer, fused.spec, fused.z))
        return found

    def believe(self, new: PreviousMap) -> None:
        """What the next scan is compared with. A scan of a layer that was scanned before takes the place of that
        one."""
        last = self._believed[-1:]
        below = last if last and last[0].layer != new.layer else self._believed[:-1]
        self._believed = [*below, new]

    def below(self, job_id: str, layer: int, spec: GridSpec) -> np.ndarray | None:
        """Surface under `layer`, (rows, cols) m; None when it is not known on these cells in this job."""
        wanted = job_id, layer - 1, spec
        found = [m.z for m in self._believed if (m.job_id, m.layer, m.spec) == wanted]
        return found[-1] if found else None

    def _width(self, session: Session, fused: FusedMap) -> BeadWidth:
        """Of the beads that were laid last, where they stand free and the surface below them is known."""
        below, laid = self.below(session.job_id, session.layer, fused.spec), session.laid
        if below is None or not laid.paths:
            return BeadWidth()
        return bead_width(below, fused.z, fused.spec, laid.paths, laid.widths)
