"""The packaged network in the loop, beside the explicit law, on a plant that neither it nor the law was made for."""

import numpy as np
from adapt_plant import MATERIAL, Plant

from waam_adapt.feed import feed_forward as ff
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.types import CorrectionInput, LastLayer

HEIGHT, WIDTH, LAYERS = 2e-3, 6e-3, 8
LIMITS = ff.Limits.of(MATERIAL, (3e-3, 20e-3), (2 / 60, 12 / 60))


def bead_paths(plant: Plant, path: ff.Path) -> tuple[np.ndarray, ...]:
    corner = np.array([plant.spec.origin_x, plant.spec.origin_y])
    ends = np.flatnonzero(np.diff(path.start[:, 1])) + 1
    return tuple(
        np.concatenate([part[:, :2], last[-1:, :2]]) - corner
        for part, last in zip(np.split(path.start, ends), np.split(path.end, ends), strict=True)
    )


def run(plant: Plant, law: str) -> tuple[float, int]:
    """RMS of the pad without its outermost 2 mm over the last four layers in m, and the number of fallbacks."""
    server, last, rms, fallbacks = Corrector(CorrectionParams(law=law)), LastLayer(), [], 0
    planned = np.where(plant.inside, HEIGHT, 0.0)
    x, y = np.meshgrid(plant.spec.x, plant.spec.y)
    m = 2e-3
    judged = (x > m) & (x < plant.length - m) & (y > m) & (y < plant.breadth - m)
    for n in range(1, LAYERS + 1):
        z = plant.scan()
        path = ff.Path(**plant.path(n, HEIGHT))
        request = CorrectionInput(
            z, np.full(z.shape, (n - 1) * HEIGHT), planned, plant.resolution, WIDTH, 0.3,
            np.full(z.shape, plant.scan_sigma), (1.0, 0.0),
            paths=bead_paths(plant, path),
        )  # fmt: skip
        answer = server.answer(n, request, MapOrigin(0.0, 'job', 'job', n - 1, n - 1, True), last)
        c = answer.correction
        fallbacks += c.fallback
        field = ff.Field(plant.spec, c.psi, c.residual_height, 0.3, answer.flow_factor)
        s = ff.compute(path, MATERIAL, LIMITS, 22.0, field)
        last = LastLayer(z, planned / c.speed_factor + c.residual_height, answer.flow_factor)
        plant.deposit(path.start, path.end, s.wire_feed_speed, s.speed)
        rms.append(float(np.mean((plant.z - n * HEIGHT)[judged] ** 2)))
    return float(np.sqrt(np.mean(rms[-4:]))), fallbacks


def test_network_is_not_worse_than_the_explicit_law():
    plants = [
        {'seed': 11},
        {'seed': 12, 'shift': True},
        {'seed': 13, 'width': 6.6e-3, 'noise': 0.07},
    ]
    plain = [run(Plant(**p), 'damped_inverse')[0] for p in plants]
    ours = [run(Plant(**p), 'unet') for p in plants]
    assert sum(f for _, f in ours) == 0
    quotient = np.array([r for r, _ in ours]) / np.array(plain)
    assert quotient.max() < 1.1, quotient
    assert np.exp(np.log(quotient).mean()) < 1.0, quotient
