"""What former jobs have taught: what a job starts with, and what it teaches in turn."""

from __future__ import annotations

import numpy as np
import pytest
from unet_layers import weights_file

from waam_adapt.identify.identification import Start
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.laws.corrector import CorrectionParams, Corrector, LastLayer
from waam_adapt.types import CorrectionInput
from waam_process.learned import Learned, nothing, parse

RES, WIDTH, H, SHAPE = 0.5e-3, 6e-3, 2e-3, (96, 96)
NOTHING = nothing('mill', 'er70s-6', 'w600_h200')
INSIDE = np.zeros(SHAPE, bool)
INSIDE[16:-16, 16:-20] = True


def zigzag() -> np.ndarray:
    points: list[tuple[float, float]] = []
    for k in range(8):
        ends = [(9e-3, 10e-3 + k * 4e-3), (36e-3, 10e-3 + k * 4e-3)]
        points += ends if k % 2 == 0 else ends[::-1]
    return np.array(points)


@pytest.fixture
def corrector(tmp_path) -> Corrector:
    return Corrector(
        CorrectionParams(law='unet', model=str(weights_file(tmp_path / 'g.npz', level=0.0)))
    )


def job(corrector: Corrector, learned: Learned | None, name: str, efficiency=0.88, layers=5):
    """The answers of a job whose layers grow by `efficiency` of what is asked for."""
    answers, surface, last = [], np.zeros(SHAPE), LastLayer()
    for n in range(1, layers + 1):
        target = np.full(SHAPE, (n - 1) * H)
        r = CorrectionInput(
            surface, target, np.where(INSIDE, H, 0.0), RES, WIDTH, 0.3,
            sigma=np.full(SHAPE, 2e-5), paths=(zigzag(),), temperature=150.0,
        )  # fmt: skip
        where = MapOrigin(0.0, name, name, n - 1, n - 1, True)
        answers.append([corrector.answer(n, r, where, last, learned) for _ in range(2)][-1])
        a = answers[-1]
        c = a.correction
        asked = np.where(INSIDE, H / (1 + c.k_gain * c.psi) + c.residual_height, 0.0)
        last = LastLayer(surface, asked, a.flow_factor)
        surface = surface + efficiency * a.flow_factor * asked
    return answers


def test_without_former_jobs_everything_is_as_before(corrector):
    assert Start.of(None) == Start.of(NOTHING) == Start()
    plain, told = job(corrector, None, 'a'), job(corrector, NOTHING.for_job('7'), 'b')
    for a, b in zip(plain, told, strict=True):
        assert a.flow_factor == b.flow_factor
        assert a.correction.psi.tobytes() == b.correction.psi.tobytes()
    assert plain[-1].learned is None and plain[0].flow_factor == 1.0


def test_the_second_job_knows_the_efficiency_before_its_first_layer(corrector):
    first = job(corrector, NOTHING, 'a')
    assert first[0].learned == NOTHING
    kept = parse(first[-1].learned.text())
    assert kept.jobs == 1 and kept.layers == 4 and kept.last_job == 'a'
    assert kept.efficiency == pytest.approx(0.88, abs=0.01)
    second = job(corrector, kept.for_job(''), 'b')
    assert second[0].flow_factor == pytest.approx(1 / 0.88, rel=0.01)
    assert second[-1].learned.jobs == 2
    assert second[-1].learned.efficiency_sigma < kept.efficiency_sigma


def test_the_job_has_the_last_word(corrector):
    wrong = job(corrector, NOTHING, 'a', 0.75)[-1].learned
    answers = job(corrector, wrong.for_job('other wire'), 'b', 1.0, layers=6)
    assert answers[0].flow_factor > 1.25
    assert answers[-1].flow_factor == pytest.approx(1.0, abs=0.02)
    assert wrong.efficiency < answers[-1].learned.efficiency < 1.0
