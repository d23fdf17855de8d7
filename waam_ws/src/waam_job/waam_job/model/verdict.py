"""The verdict of the last scan on the whole job: in tolerance, out of tolerance, not judged, or failed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .geometry import Deviation


@dataclass(frozen=True)
class Verdict:
    """Over the region and the final surface of the first plan, however many passes there were."""

    share_wanted: float  # of the interior that must lie within the tolerance
    tolerance: float  # m
    final: Deviation | None = None  # None: the job did not reach its last scan
    as_found_rms: float = math.nan  # m, of the surface before the job
    tolerance_map: dict | None = None  # counts of tolerance_map.csv

    @property
    def not_judged(self) -> str:
        """Why a finished job has no verdict, '' when it has one."""
        if self.final is None or self.final.seen:
            return ''
        if not self.final.cells:
            return 'no place of the region is half a bead or more away from its edge'
        return 'the last scan has seen nothing of the interior'

    @property
    def in_tolerance(self) -> bool:
        """Also False when nothing could be judged."""
        found = self.final
        return found is not None and found.seen and found.share_in_tolerance >= self.share_wanted

    @property
    def word(self) -> str:
        """For report.json."""
        if self.final is None:
            return 'failed'
        if self.not_judged:
            return f'not judged: {self.not_judged}'
        return 'in tolerance' if self.in_tolerance else 'out of tolerance'

    @property
    def text(self) -> str:
        """For people, with the figures."""
        if self.final is None or self.not_judged:
            return self.word
        rms, share = self.final.rms * 1e3, self.final.share_in_tolerance * 100
        within = f'{share:.1f} % of the interior within +-{self.tolerance * 1e3:.2f} mm'
        return f'RMS {rms:.3f} mm, {within}'
