"""The verdict of the last scan on the whole job: in tolerance, out of tolerance, not judged, or failed;
with finish machined cleans up or does not clean up."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waam_plan.finish import Unlaid
from waam_process import verdicts

from .geometry import Deviation
from .overrun import Overrun
from .shaft import ShaftFigures
from .stock import Stock


@dataclass(frozen=True)
class Verdict:
    """Over the region and the final surface of the first plan, however many passes there were."""

    share_wanted: float  # of the judged area that must lie within the tolerance
    tolerance: float  # m
    final: Deviation | None = None  # None: the job did not reach its last scan
    as_found_rms: float = math.nan  # m, of the surface before the job
    tolerance_map: dict | None = None  # counts of tolerance_map.csv
    overrun: Overrun = Overrun()
    stock: Stock | None = None  # of a job with finish machined
    unlaid: Unlaid | None = None  # of a restoration
    shaft: ShaftFigures | None = None  # of a shaft

    @property
    def not_judged(self) -> str:
        """Why a finished job has no verdict, '' when it has one."""
        if self.final is None or self.final.seen:
            return ''
        if not self.final.cells:
            return 'all of the region belongs to its rim'
        return 'the last scan has seen nothing of the judged area'

    @property
    def good(self) -> bool:
        """Cleans up, with finish machined; else in tolerance."""
        if self.stock is None or self.final is None or self.not_judged:
            return self.in_tolerance
        return self.stock.cleans_up

    @property
    def in_tolerance(self) -> bool:
        """Also False when nothing could be judged."""
        found = self.final
        return found is not None and found.seen and found.share_in_tolerance >= self.share_wanted

    @property
    def in_tolerance_all(self) -> bool:
        """The same with the rim."""
        found = self.final
        return found is not None and found.seen and found.share_all >= self.share_wanted

    @property
    def word(self) -> str:
        """For report.json."""
        return self._word(self.in_tolerance)

    @property
    def word_all(self) -> str:
        """For report.json: the verdict with the rim."""
        return self._word(self.in_tolerance_all)

    def _word(self, good: bool) -> str:
        if self.final is None:
            return verdicts.FAILED
        if self.not_judged:
            return f'{verdicts.NOT_JUDGED}: {self.not_judged}'
        if self.stock is not None:
            return verdicts.CLEANS_UP if self.stock.cleans_up else verdicts.DOES_NOT_CLEAN_UP
        return verdicts.IN_TOLERANCE if good else verdicts.OUT_OF_TOLERANCE

    @property
    def text(self) -> str:
        """For people, with the figures."""
        if self.final is None or self.not_judged:
            return self.word
        rms, share = self.final.rms * 1e3, self.final.share_in_tolerance * 100
        within = f'{share:.1f} % of the judged area within +-{self.tolerance * 1e3:.2f} mm'
        all_of_it = f'{self.final.rms_all * 1e3:.3f} mm, {self.final.share_all * 100:.1f} %'
        if self.stock is not None:
            text = f'{self.stock.text}; RMS from what was aimed at {rms:.3f} mm'
        else:
            text = f'RMS {rms:.3f} mm, {within}; with the rim {all_of_it}, {self.word_all}'
        if math.isfinite(self.overrun.max):
            text += f'; {self.overrun.max * 1e3:.1f} mm over the sides'
        if self.shaft is not None and self.shaft.text:
            text += f'; {self.shaft.text}'
        if self.unlaid is not None and self.unlaid.area:
            text += f'; {self.unlaid.text}'
        return f'{self.word}: {text}'
