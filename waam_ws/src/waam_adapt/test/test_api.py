import numpy as np
import pytest

import waam_adapt
from waam_adapt.types import CorrectionError

HUMP = np.zeros((80, 120))
HUMP[30:50, 50:70] = 0.4  # mm too high
LINE = np.stack([np.linspace(2, 58, 57), np.full(57, 20.0)], axis=1)


def test_speed_factors_along_a_path():
    (factors,) = waam_adapt.correct(HUMP, 0.5, [LINE], 2.0, direction=(1, 0))
    assert factors.shape == (57,)
    assert factors[28] > 1.1
    assert factors[0] == pytest.approx(1.0, abs=0.01)
    (slower,) = waam_adapt.correct(-HUMP, 0.5, [LINE], 2.0)
    assert slower[28] < 0.9


def test_a_wall_answers_more_weakly_so_more_is_asked():
    (pad,) = waam_adapt.correct(HUMP * 0.2, 0.5, [LINE], 2.0)
    (wall,) = waam_adapt.correct(HUMP * 0.2, 0.5, [LINE], 2.0, height_exponent=-0.4)
    assert wall[28] - 1 == pytest.approx((pad[28] - 1) / 0.4, rel=0.15)


def test_units_frame_and_limits():
    shifted = [LINE + (100.0, -40.0)]
    args = (HUMP, 0.5, shifted, 2.0)
    moved = waam_adapt.correct(*args, origin_mm=(100.0, -40.0))[0]
    assert moved == pytest.approx(waam_adapt.correct(HUMP, 0.5, [LINE], 2.0)[0])
    assert (waam_adapt.correct(*args)[0] == 1.0).all()  # outside the map
    strong = waam_adapt.correct(HUMP * 10, 0.5, [LINE], 2.0, k_gain=0.2)[0]
    assert strong.max() == pytest.approx(1.2)


def test_unknown_cells_and_many_paths():
    nothing = np.full((80, 120), np.nan)
    out = waam_adapt.correct(nothing, 0.5, [LINE, np.zeros((0, 2)), np.ones((3, 3))], 2.0)
    assert [f.shape for f in out] == [(57,), (0,), (3,)]
    assert (out[0] == 1.0).all()


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'error_map_mm': np.zeros(5)}, 'error_map_mm'),
        ({'paths': [LINE, np.full((3, 2), np.nan)]}, r'paths\[1\]'),
        ({'paths': [np.zeros(4)]}, r'paths\[0\]'),
        ({'layer_height_mm': 0.0}, 'layer_height_mm'),
        ({'layer_height_mm': np.ones((2, 2))}, 'layer_height_mm'),
        ({'resolution_mm': 0.0}, 'resolution'),
        ({'bead_width_mm': np.nan}, 'bead_width'),
        ({'height_exponent': 0.3}, 'height_exponent'),
        ({'law': 'magic'}, 'known are'),
    ],
)
def test_what_cannot_be_used_is_named(changes, word):
    values = {
        'error_map_mm': HUMP,
        'resolution_mm': 0.5,
        'paths': [LINE],
        'layer_height_mm': 2.0,
    } | changes
    with pytest.raises(CorrectionError, match=word):
        waam_adapt.correct(**values)
