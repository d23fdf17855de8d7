"""Jobs of the laboratory whose loop diverges, or that one scan deceives."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from waam_job.conversions import correction_from_msg
from waam_lab import laboratory
from waam_lab.cell import LabCell
from waam_lab.job import LabResult
from waam_process.operating import DEFAULT_PRESET
from waam_sim.plant import Profiles

from .jaw import jaw_job

SAID = re.compile(r'the error grows from layer to layer.* after layer (\d+)')


class Scaled(LabCell):
    """Psi and residual height arrive times `factor` from the second layer on."""

    factor = -1.0

    def correct(self, job_id, request):
        """Not what the server answered."""
        answer = super().correct(job_id, request)
        if request.layer == 1:
            return answer
        m = answer.handle
        m.psi = np.clip(self.factor * np.asarray(m.psi, np.float32), -1.0, 1.0)
        m.residual_height = self.factor * np.asarray(m.residual_height, np.float32)
        return correction_from_msg(m, answer.learned)


class TooMuch(Scaled):
    """Each layer asks for more than twice of what is missing."""

    factor = 2.6


class Jumped(LabCell):
    """The first scan after layer 3 stands 0.3 mm too high."""

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self._raised, self._scans, told = False, 0, self.scanning.on_profiles

        def on_profiles(profiles: Profiles) -> None:
            told(replace(profiles, z=profiles.z + np.float32(0.3e-3)) if self._raised else profiles)

        self.device.on_profiles = on_profiles

    def begin_scan(self, job_id, layer, spec, laid):
        """Counts the scans after layer 3."""
        self._scans += layer == 3
        self._raised = layer == 3 and self._scans == 1
        return super().begin_scan(job_id, layer, spec, laid)


DIVERGING = {'correction with the wrong sign': Scaled, 'correction 2.6 times too large': TooMuch}


def run_on(cell: type[LabCell], seed: int) -> LabResult:
    """The jaw on a cell of this class."""
    kept, laboratory.LabCell = laboratory.LabCell, cell
    try:
        return laboratory.run(jaw_job(seed=seed, preset=DEFAULT_PRESET))
    finally:
        laboratory.LabCell = kept


def growing_layers_until_pause(found: LabResult) -> int:
    """Layers in a row whose error was larger than that before each, the last of which the job paused after; all layers
    in a row that grew, where it never did."""
    rms = [math.inf, *found.layer_rms]  # by layer
    paused = [int(m[1]) for a in found.anomalies if (m := SAID.search(a['text']))]
    runs, run = [0] * len(rms), 0
    for n in range(2, len(rms)):
        runs[n] = run = run + 1 if rms[n] > rms[n - 1] else 0
    return runs[paused[0]] if paused else max(runs)
