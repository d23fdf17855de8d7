"""Law, identification and feed-forward around a plant that is not the controller's model (`adapt_plant`)."""

from dataclasses import dataclass

import numpy as np
import pytest
from adapt_plant import MATERIAL, Plant

from waam_adapt.feed import feed_forward as ff
from waam_adapt.identify import identification
from waam_adapt.laws import explicit as laws
from waam_adapt.types import CorrectionInput, CorrectionLaw

LIMITS = ff.Limits.of(MATERIAL, (3e-3, 20e-3), (2 / 60, 12 / 60))
HEIGHT, WIDTH, K_GAIN = 2e-3, 6e-3, 0.3


@dataclass
class Run:
    rms: list[float]  # m, after every layer, interior
    ratio: list[float]  # identified efficiency
    psi: np.ndarray  # of the last layer
    error: np.ndarray  # m, last


def run(
    plant: Plant,
    law: CorrectionLaw,
    apply: bool = True,
    layers: int = 10,
    learning: float = 0.3,
) -> Run:
    """Scan, correct, deposit, layer by layer, as the job does it."""
    identifier, last = identification.Identifier(learning=learning), None
    planned = np.where(plant.inside, HEIGHT, 0.0)
    result = Run([], [], planned, planned)
    for n in range(1, layers + 1):
        z = plant.scan()
        request = CorrectionInput(
            z, np.full(z.shape, (n - 1) * HEIGHT), planned, plant.resolution, WIDTH, K_GAIN,
            np.full(z.shape, plant.scan_sigma), (1.0, 0.0),
        )  # fmt: skip
        identifier.start('job', n)
        if last is not None:
            identifier.add(identification.Layer(last[0], z, last[1], plant.resolution, WIDTH))
        estimate = identifier.estimate
        c = law.correct(identifier.prepare(request))
        path = ff.Path(**plant.path(n, HEIGHT))
        field = ff.Field(plant.spec, c.psi, c.residual_height, K_GAIN, estimate.flow_factor())
        s = ff.compute(path, MATERIAL, LIMITS, 22.0, field, apply)
        asked = planned / c.speed_factor + c.residual_height if apply else planned
        last = z, np.where(plant.inside, asked * s.flow_factor, 0.0)
        plant.deposit(path.start, path.end, s.wire_feed_speed, s.speed)
        result.error = plant.z - n * HEIGHT
        result.psi = c.psi
        result.rms.append(float(np.sqrt(np.mean(result.error[plant.interior] ** 2))))
        result.ratio.append(estimate.efficiency_ratio)
    return result


def open_loop(**plant) -> Run:
    return run(Plant(**plant), laws.Zero(), apply=False)


@pytest.mark.parametrize(
    'plant', [{}, {'seed': 1, 'shift': True}, {'width': 7e-3}, {'efficiency': 0.75}], ids=str
)
def test_closed_loop_ends_far_below_a_fifth_of_the_open_loop(plant):
    closed = run(Plant(**plant), laws.DampedInverse())
    assert closed.rms[-1] < 0.1 * open_loop(**plant).rms[-1]


def test_efficiency_is_identified_and_stays():
    """What the layer needs on average: its edge is in the mean, so it lies below the 0.85 of the plant."""
    plant = Plant()
    closed = run(plant, laws.DampedInverse())
    assert np.array(closed.ratio[2:]) == pytest.approx(0.83, abs=0.03)
    assert abs(closed.error[plant.interior].mean()) < 0.03e-3


def test_error_does_not_oscillate_or_grow():
    """Without noise every settled layer is about as good as the best one, and the level does not swing."""
    plant = Plant(noise=0.0, scan_sigma=1e-9)
    closed = run(plant, laws.DampedInverse(), layers=16)
    settled = closed.rms[3:]
    assert max(settled) < 1.5 * min(settled)
    assert abs(closed.error[plant.interior].mean()) < 0.06e-3


@pytest.mark.parametrize('gain', [0.5, 0.9, 1.2])
def test_stable_over_the_whole_range_of_the_gain_parameter(gain):
    closed = run(Plant(width=4.8e-3), laws.DampedInverse(gain), layers=14)
    assert closed.rms[-1] < 1.6 * min(closed.rms)


def pitch_ripple(values: np.ndarray, plant: Plant) -> float:
    """Amplitude of the wave of one bead pitch across the beads, in the middle of the pad."""
    beads = plant.beads(1)
    y = plant.spec.y
    rows = (y > beads[1]) & (y < beads[-2])
    mean = values[rows][:, 40:-40].mean(axis=1)
    wave = np.exp(2j * np.pi * y[rows] / (beads[1] - beads[0]))
    return float(2 * abs(((mean - mean.mean()) * wave).mean()))


def test_ripple_of_the_beads_is_not_amplified():
    plant, reference = Plant(noise=0.0), Plant(noise=0.0)
    closed = run(plant, laws.DampedInverse())
    opened = run(reference, laws.Zero(), apply=False)
    assert pitch_ripple(closed.error, plant) < 1.5 * pitch_ripple(opened.error, reference)
    assert pitch_ripple(closed.psi, plant) < 0.02
