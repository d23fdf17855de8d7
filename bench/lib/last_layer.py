"""What there is to know of the last layer of a job: it is laid again and again with other noise of the metal, and what
it came out too high or too low goes into what the correction is told to expect of it. What repeats is learned, noise is
not. The jobs before the last layer are the same bits each time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

import numpy as np
from scipy.ndimage import gaussian_filter

from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.laws.unet_law import UNetLaw
from waam_adapt.types import CorrectionInput, Predicted
from waam_lab import LabJob, LabResult
from waam_lab.laboratory import run
from waam_lab.metal_trace import MetalTrace
from waam_lab.watch import LayerWatch
from waam_sim.disturbance import AREA_LAYER, lattice
from waam_sim.plant import Plant

# weight of what a round has shown; it falls, so that noise is averaged
WEIGHTS = (1.0, 0.7, 0.6, 0.5, 0.4, 0.35, 0.3, 0.25, 0.22, 0.2)
FRESH_NOISE = (9001, 9002, 9003, 9004)  # for judging
WAYS = ('bead_solver', 'unet', 'known')
MOST_SEEN, MOST = (
    0.5,
    0.8,
)  # share of the planned height that one round shows at most, and that is expected at most
THIN = 0.3  # thinner cells of a layer, over its median, show nothing
SMOOTH = 0.7  # cells of the bead model


class OtherNoise(MetalTrace):
    """Puts another noise of the metal into the cell when layer `last` begins; notes nothing."""

    def __init__(self, last: int, seed: int) -> None:
        super().__init__()
        self.last, self.seed = last, seed

    def on_layer(self, number: int, plant: Plant) -> None:
        """What changes from layer to layer is drawn again; what is fixed to the place stays the cell's own."""
        if number == self.last:
            plant._lattice[AREA_LAYER:] = lattice(self.seed)[AREA_LAYER:]


class Known(Predicted):
    """A prediction that is believed."""

    def weighed(self, weight: float) -> Known:
        """As it is."""
        return replace(self, weight=1.0)


@contextmanager
def expecting(last: int, growth: np.ndarray | None) -> Iterator[None]:
    """The law unet is told the growth of layer `last` (share of the plan, model's grid), and believes it."""
    own, asked = UNetLaw.predict, 0

    def predict(law: UNetLaw, request: CorrectionInput) -> Predicted:
        nonlocal asked
        asked += 1
        found = own(law, request)
        if growth is None or asked != last:
            return found
        return Known(growth, found.sigma, found.digest, level=found.level)

    with mock.patch.object(UNetLaw, 'predict', predict):
        yield


def laid(
    job: LabJob, last: int, noise: int, growth: np.ndarray | None
) -> tuple[LabResult, LayerWatch]:
    """The job with other noise in its last layer. RuntimeError when it fails."""
    watch = LayerWatch()
    with expecting(last, growth):
        result = run(job, OtherNoise(last, noise), watch)
    if result.failed:
        raise RuntimeError(f'seed {job.seed}: {result.message}')
    return result, watch


def missed(watch: LayerWatch) -> np.ndarray:
    """How much too high the last layer came out, share of its planned height, on the grid of the bead model."""
    request = watch.layers[-1].request
    cell = request.bead_width / CELLS_PER_BEAD
    grid = Resampler.of(request.z.shape, request.resolution, cell)
    planned = np.where(request.footprint, request.planned, np.nan)
    assert watch.last is not None
    error = (watch.last - request.target - planned) / planned
    seen = np.isfinite(error) & (planned > THIN * np.nanmedian(planned))
    share = grid.mean(seen.astype(float))
    total = grid.mean(np.where(seen, np.clip(error, -MOST_SEEN, MOST_SEEN), 0.0))
    inside = (share > 0.2).astype(float)
    mean = inside * total / np.maximum(share, 1e-3)
    spread = np.maximum(gaussian_filter(inside, SMOOTH), 1e-3)
    return inside * gaussian_filter(mean, SMOOTH) / spread


def learn(job: LabJob, last: int) -> np.ndarray:
    """What the last layer of this job grows beside the bead model, learned over rounds of other noise."""
    growth: np.ndarray | None = None
    for number, weight in enumerate(WEIGHTS):
        _, watch = laid(job, last, number + 1, growth)
        shown = missed(watch)
        before = np.zeros_like(shown) if growth is None else growth
        growth = np.clip(before + weight * shown, -MOST, MOST)
    assert growth is not None
    return growth


def rms_by_way(job: LabJob) -> np.ndarray:
    """(3,) m: RMS at the end by WAYS, each the mean over FRESH_NOISE in the last layer."""
    solver, network = (
        replace(job, overrides={'correction_server': {'law': name}}) for name in WAYS[:2]
    )
    last = laid(network, 0, 0, None)[0].layers
    known = learn(network, last)
    ways = ((solver, None), (network, None), (network, known))
    found = [
        [laid(one, last, noise, growth)[0].rms for noise in FRESH_NOISE] for one, growth in ways
    ]
    return np.mean(found, axis=1)
