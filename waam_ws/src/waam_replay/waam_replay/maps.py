"""Height maps again, from the recorded profiles and telemetry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from waam_node.conversions import grid_from_msg, nanoseconds
from waam_record.read_record import Exchange, Record
from waam_scan.fusion_params import FusionParams
from waam_scan.map_maker import MapMaker
from waam_scan.stream.profiles import ProfileBlock, read_batch
from waam_scan.stream.session import Session

# as scan_fusion: profiles older than its clock by up to this belong to the scan
CLOCK_GRAIN_NS = 100_000_000


@dataclass(frozen=True)
class MapAgain:
    """One scan: the recorded map (message) and the same computed again; z, sigma (rows, cols) float32 in m, count."""

    recorded: Any  # waam_msgs/HeightMap
    z: np.ndarray
    sigma: np.ndarray
    count: np.ndarray
    plausible: bool
    reasons: tuple[str, ...]
    whole: bool  # all profiles that went into the recorded map are in the record

    @property
    def layer(self) -> int:
        """Layers that lay on the part when it was scanned."""
        return self.recorded.layer

    @property
    def identical(self) -> bool:
        """To the last bit."""
        m = self.recorded
        return (
            np.asarray(m.z, np.float32).tobytes() == self.z.tobytes()
            and np.asarray(m.sigma, np.float32).tobytes() == self.sigma.tobytes()
            and np.asarray(m.count, np.uint16).tobytes() == self.count.tobytes()
        )

    @property
    def difference(self) -> tuple[float, float]:
        """RMS and largest difference of heights in m over cells that both know; NaN when there is none."""
        old = np.asarray(self.recorded.z, np.float32).reshape(self.z.shape).astype(float)
        d = (self.z.astype(float) - old)[np.isfinite(self.z) & np.isfinite(old)]
        if not d.size:
            return float('nan'), float('nan')
        return float(np.sqrt(np.mean(d**2))), float(np.abs(d).max())


class Mapper:
    """Feeds the cores of scan_fusion in the recorded order; scans must be asked for in order."""

    def __init__(self, record: Record, params: FusionParams) -> None:
        self.record, self._maker = record, MapMaker(params)
        self._fed = self._batch = 0

    def all(self) -> list[MapAgain]:
        """Every scan that gave a map."""
        made = []
        finishes = self.record.calls['finish']
        for begin in self.record.calls['begin']:
            if begin.response is None or begin.response.error_code:
                continue
            # of older versions: a scan beside the arc, which gave no map of the part
            if getattr(begin.request, 'in_process', False):
                continue
            end = next((f for f in finishes if f.at_ns > begin.at_ns), None)
            if end is None or end.response is None or end.response.error_code:
                continue
            made.append(self._one(begin, end))
        return made

    def _one(self, begin: Exchange, end: Exchange) -> MapAgain:
        session = self._session(begin)
        wanted = end.response.map.profiles_used + end.response.map.profiles_rejected
        profiles = 0
        for sequence, block in self._blocks(begin.at_ns, end.answered_ns):
            if profiles >= wanted:
                break
            self._feed(int(block.stamps.max()))
            session.add_batch(sequence, block)
            profiles += len(block)
        session.until_ns = nanoseconds(end.request.until)
        self._feed(max(session.until_ns, session.newest_ns or 0))
        found = self._maker.finish(session)
        fused = found.fused
        return MapAgain(
            recorded=end.response.map,
            z=fused.z,
            sigma=fused.sigma,
            count=fused.count,
            plausible=not found.doubts,
            reasons=tuple(found.doubts + session.notes()),
            whole=profiles == wanted,
        )

    def _session(self, begin: Exchange) -> Session:
        asked, earliest = begin.request, begin.ros_ns - CLOCK_GRAIN_NS
        spec, scan_id = grid_from_msg(asked.grid), begin.response.scan_id
        return self._maker.begin(
            asked.job_id, asked.layer, scan_id, spec, earliest, keep=asked.keep
        )

    def _blocks(self, after_ns: int, before_ns: int) -> Iterator[tuple[int, ProfileBlock]]:
        batches = self.record.batches
        while self._batch < len(batches) and batches[self._batch][0] < before_ns:
            at, data = batches[self._batch]
            self._batch += 1
            if at > after_ns:
                yield read_batch(data)

    def _feed(self, until_ns: int) -> None:
        """Telemetry up to the first frame that is not older than `until_ns`."""
        stamps, positions = self.record.stamps, self.record.positions
        while self._fed < len(stamps):
            t = int(stamps[self._fed])
            self._maker.track.append(t, *positions[self._fed].tolist())
            self._fed += 1
            if t >= until_ns:
                return
