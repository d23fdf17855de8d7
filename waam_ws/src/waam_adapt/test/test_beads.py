"""The bead model, what is learned beside it, and the law that solves through it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from waam_adapt import filters
from waam_adapt.beads import solver as bead_solver
from waam_adapt.beads.bead_bias import BeadBias
from waam_adapt.beads.model import bead_model, inner_mean
from waam_adapt.feed import feed_forward as ff
from waam_adapt.grids import CELLS_PER_BEAD, Resampler
from waam_adapt.identify.evidence import Layer
from waam_adapt.identify.identification import Identifier
from waam_adapt.laws import explicit as laws
from waam_adapt.laws.registry import make_law
from waam_adapt.types import RATIO_HIGH, RATIO_LOW, BeadDeviation, CorrectionInput
from waam_process.grid import GridSpec
from waam_process.segment import Kind

W, H, PITCH = 6e-3, 2e-3, 4.4e-3
CELL = W / CELLS_PER_BEAD
SIZE = (28, 40)  # cells of the model's grid
CORNER, LENGTH, BEADS = np.array([6e-3, 6e-3]), 48e-3, 7


def zigzag(turn: int = 0, beads: int = BEADS) -> tuple[np.ndarray, ...]:
    lines = [CORNER + np.array([[0.0, y], [LENGTH, y]]) for y in (np.arange(beads) + 0.5) * PITCH]
    return tuple(p if (i + turn) % 2 == 0 else p[::-1] for i, p in enumerate(lines))


def pad(resolution: float, error=0.0, **changes) -> CorrectionInput:
    """error: of cells or all, m, missing metal."""
    rows, cols = (round(n * CELL / resolution) for n in SIZE)
    y, x = (np.arange(n) * resolution + 0.5 * resolution for n in (rows, cols))
    inside = np.outer(
        (y > CORNER[1]) & (y < CORNER[1] + BEADS * PITCH),
        (x > CORNER[0]) & (x < CORNER[0] + LENGTH),
    )
    z = -np.broadcast_to(error, inside.shape)
    values = {
        'z': z, 'target': np.zeros(z.shape), 'planned': np.where(inside, H, 0.0), 'resolution': resolution,
        'bead_width': W, 'k_gain': 0.3, 'sigma': np.full(z.shape, 1e-6), 'direction': (1.0, 0.0),
        'paths': zigzag(),
    }  # fmt: skip
    return CorrectionInput(**(values | changes))


def refined(request: CorrectionInput, gain: float = 1.0) -> np.ndarray:
    grid = Resampler.of(request.z.shape, request.resolution, request.bead_width / CELLS_PER_BEAD)
    return bead_solver.refine(request, np.ones(request.z.shape), gain, grid)


def test_the_plan_gives_the_plan_wherever_beads_reach():
    model = bead_model(zigzag(), SIZE, W)
    growth = model.growth(np.ones(len(model.first)), 0.0)
    assert growth[growth > 0] == pytest.approx(1.0)
    assert (growth[5:20, 5:35] > 0).all()
    assert not growth[:, -2:].any()
    assert model.overlapped
    assert not bead_model(zigzag(beads=1), SIZE, W).overlapped
    chain = (np.concatenate(zigzag()),)  # without putting the arc out
    assert bead_model(chain, SIZE, W).overlapped


@pytest.mark.parametrize('turn', [0, 1])
def test_metal_that_comes_late_lies_further_along_the_travel(turn):
    model = bead_model(zigzag(turn)[:1], SIZE, W)
    pulse = np.zeros(len(model.first))
    pulse[len(pulse) // 2] = 1.0
    x = (np.arange(SIZE[1]) + 0.5) * CELL

    def centre(lag):
        share = model.growth(pulse, lag).sum(axis=0)
        return (share * x).sum() / share.sum()

    assert centre(2e-3) - centre(0.0) == pytest.approx(-2e-3 if turn else 2e-3, abs=1e-4)


def cut(path: np.ndarray, length: float) -> np.ndarray:
    """The straight path with the ends of segments of that length."""
    n = round(float(np.hypot(*(path[-1] - path[0]))) / length)
    return path[0] + np.linspace(0, 1, n + 1)[:, None] * (path[-1] - path[0])


def test_a_setpoint_holds_from_one_told_point_to_the_next():
    paths = tuple(cut(p, 4e-3) for p in zigzag())
    model = bead_model(paths, SIZE, W)
    assert len(model.first) == BEADS * 12
    begin, end = paths[0][:-1], paths[0][1:]
    assert model.points[:12] == pytest.approx(np.stack([begin, 0.5 * (begin + end), end], 1))
    one = (np.arange(len(model.first)) == 5) * 1.0  # from 20 to 24 mm
    driven = model.driven(1.5e-3) @ one
    assert driven @ np.diff(model.pieces).ravel() == pytest.approx(4e-3)
    assert np.flatnonzero(driven > 1e-9).tolist() == [14, 15, 16]  # of 1.5 mm
    assert model.driven(0.7e-3).sum(axis=1) == pytest.approx(1.0)


def test_points_close_together_are_joined_and_long_ways_are_cut():
    line = zigzag()[0]
    assert len(bead_model((cut(line, 0.1e-3),), SIZE, W).first) == 32
    assert len(bead_model((line,), SIZE, W).first) == 16


def test_the_model_reads_a_map_as_the_feed_forward_does():
    """What is solved for is what the segments get in the end."""
    paths = tuple(cut(p, 3e-3) for p in zigzag())
    model, resolution = bead_model(paths, SIZE, W), CELL / 5
    wish = 1 + 0.3 * np.sin(2.5 * np.arange(len(model.first)))
    grid = Resampler.of((SIZE[0] * 5, SIZE[1] * 5), resolution, CELL)
    field = grid.fine(model.on_cells(wish))
    start, middle, end = (np.pad(model.points[:, i], ((0, 0), (0, 1))) for i in range(3))
    n = len(start)
    path = ff.Path(np.arange(n), np.full(n, int(Kind.DEPOSIT)), start, end, *np.ones((3, n)))
    _, read, _ = ff.sample(
        ff.Field(GridSpec(0, 0, resolution, *field.shape), 0 * field, 0.01 * field, 0.3), path
    )
    inner = model.to_arc > 4e-3
    off = [np.abs(100 * read - expected)[inner].max() for expected in (model.read @ wish, wish)]

    assert off[0] < 0.5 * off[1]

    assert model.of_cells(field, resolution)[inner] == pytest.approx(100 * read[inner], abs=0.03)
    assert model.read.sum(axis=1) == pytest.approx(1.0)


def test_solution_is_that_of_bounded_least_squares():
    model, rng = bead_model(zigzag(), SIZE, W), np.random.default_rng(1)
    need = _waves(rng)
    weight = (rng.random(SIZE) > 0.2) * 1.0
    x = bead_solver.solve(model, need, weight, np.ones(len(model.first)), 1e-3) - 1
    high = np.where(model.to_arc < bead_solver.END_REACH * W, bead_solver.END_HIGH, RATIO_HIGH)
    assert (x >= RATIO_LOW - 1).all()
    assert (x <= high - 1).all()
    w = weight.ravel()
    a = (model.spread @ model.driven(1e-3) @ model.read).toarray()
    typical = np.median((a**2 * w[:, None]).sum(axis=0))
    n = len(x)
    joined = model.first[1:] == model.first[:-1]
    near = np.minimum(model.to_arc[1:], model.to_arc[:-1]) < bead_solver.LOOSE * W
    loose = np.sqrt(np.where(near, bead_solver.LOOSE_SHARE, 1.0))
    falls = (loose[:, None] * np.diff(np.eye(n), axis=0))[joined]
    stacked = np.concatenate([
        np.sqrt(w)[:, None] * a, np.sqrt(bead_solver.SMALL * typical) * np.eye(n),
        np.sqrt(bead_solver.SMOOTH * typical) * falls,
    ])  # fmt: skip
    right = np.concatenate([np.sqrt(w) * need.ravel(), np.zeros(n + len(falls))])
    best = lsq_linear(stacked, right, (RATIO_LOW - 1, high - 1)).x
    cost, least, nothing = (np.sum((stacked @ v - right) ** 2) for v in (x, best, np.zeros(n)))
    assert cost - least < 0.03 * (nothing - least)


def test_a_crater_is_filled_by_the_last_segment_and_a_hollow_in_the_bead_by_its_neighbours_too():
    """The same hollow, 3 mm of one bead: at arc off, and in the middle."""
    model = bead_model(zigzag(), SIZE, W)
    row = int((CORNER[1] + 3.5 * PITCH) / CELL)
    steps = []
    for column in (int((CORNER[0] + LENGTH) / CELL) - 2, SIZE[1] // 2):
        need = np.zeros(SIZE)
        need[row - 1 : row + 2, column : column + 2] = 0.6
        x = bead_solver.solve(model, need, np.ones(SIZE), np.ones(len(model.first)), 0.0)
        own = (model.first == model.first[int(np.argmax(x))]).nonzero()[0]
        steps.append(float(np.abs(np.diff(x[own])).max()))
    assert steps[0] > 1.5 * steps[1]


def test_the_end_of_a_bead_in_a_corner_is_filled_less():
    """Most of its metal falls on cells that do not count."""
    model = bead_model(zigzag(), SIZE, W)
    everywhere, inside = np.ones(SIZE), np.zeros(SIZE)
    rows, cols = (int((CORNER[i] + 4e-3) / CELL) for i in (1, 0))
    inside[rows:, cols:] = 1.0
    asked = [
        bead_solver.solve(model, np.full(SIZE, 4.0), w, np.ones(len(model.first)), 0.0)[0]
        for w in (everywhere, inside)
    ]
    assert 1.5 < asked[1] < RATIO_HIGH < asked[0]


def test_a_request_can_bound_all_segments_lower():
    model, where = bead_model(zigzag(), SIZE, W), np.ones(SIZE)
    start = np.ones(len(model.first))
    free, bound = (
        bead_solver.solve(model, np.full(SIZE, 4.0), where, start, 0.0, top) for top in (0.0, 1.8)
    )
    assert free.max() > RATIO_HIGH
    assert bound.max() == pytest.approx(1.8)


def _waves(rng: np.random.Generator) -> np.ndarray:
    """(rows, cols) as strong as limits are reached."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    phase = rng.uniform(0, 6, 2)
    return 0.9 * np.sin(x / 4 + phase[0]) * np.cos(y / 5 + phase[1])


def test_where_nothing_is_known_the_wish_stays():
    model = bead_model(zigzag(), SIZE, W)
    wish = 1 + 0.3 * np.sin(np.arange(len(model.first)))
    x = bead_solver.solve(model, np.ones(SIZE), np.zeros(SIZE), wish, 0.0)
    assert x == pytest.approx(wish)


def test_missing_height_is_asked_for_in_the_share_gain_and_what_is_learned_in_full():
    x = refined(pad(0.5e-3, error=0.2e-3), gain=0.5)
    middle = (slice(30, 50), slice(40, 80))
    assert x[middle] == pytest.approx(1 + 0.5 * 0.1, abs=4e-3)
    learned = BeadDeviation(np.full(SIZE, 0.1))
    assert refined(pad(0.5e-3, learned=learned), 0.5)[middle] == pytest.approx(1.1, abs=8e-3)


def test_the_flank_is_not_filled_but_what_lies_inside_of_it_is():
    shape = pad(0.5e-3).z.shape
    x = np.arange(shape[1]) * 0.5e-3 + 0.25e-3
    flank, inner = (
        np.where((x > CORNER[0] + a) & (x < CORNER[0] + b), 0.6e-3, 0.0) for a, b in ((0, 1.5e-3), (2e-3, 3.5e-3))
    )  # fmt: skip
    end = int((CORNER[0] + 1e-3) / 0.5e-3)
    assert np.abs(refined(pad(0.5e-3, error=flank)) - 1).max() < 1e-6
    assert (refined(pad(0.5e-3, error=inner))[25:55, end] > 1.2).all()


def test_same_answer_on_a_finer_map_and_for_beads_of_another_size():
    rng = np.random.default_rng(5)
    coarse = pad(0.75e-3, error=4e-4 * rng.standard_normal(pad(0.75e-3).z.shape))
    names = ('z', 'target', 'planned', 'sigma')
    fine = replace(
        coarse, resolution=0.375e-3,
        **{k: np.repeat(np.repeat(getattr(coarse, k), 2, 0), 2, 1) for k in names},
    )  # fmt: skip
    a, b = refined(coarse), refined(fine)
    b = b.reshape(a.shape[0], 2, a.shape[1], 2).mean(axis=(1, 3))
    assert np.abs(a - 1).max() > 0.1
    assert np.abs(a - b).max() < 0.02
    larger = replace(
        coarse, resolution=1.5e-3, bead_width=2 * W, paths=tuple(2 * p for p in coarse.paths),
        **{k: 2 * getattr(coarse, k) for k in names},
    )  # fmt: skip
    assert refined(larger) == pytest.approx(refined(coarse), abs=1e-9)


def test_weights_of_cells_at_the_edge_do_not_depend_on_the_resolution():
    one = np.zeros((20, 20), bool)
    one[3:17, 4:18] = True
    two = one.repeat(2, 0).repeat(2, 1)
    share = filters.inner_share(two, 2 * 1.3).reshape(20, 2, 20, 2).mean(axis=(1, 3))
    straight = (slice(6, 14), slice(None))
    assert share[straight] == pytest.approx(filters.inner_share(one, 1.3)[straight])


def test_paths_beside_the_map_or_of_no_length_change_nothing():
    beside = tuple(p + 1.0 for p in zigzag())
    still = (np.tile(CORNER + 10e-3, (2, 1)),)
    for paths in (beside, still):
        x = refined(pad(0.75e-3, error=0.3e-3, paths=paths))
        assert np.isfinite(x).all()
    assert (refined(pad(0.75e-3, error=0.3e-3, paths=beside)) == 1).all()


def lay(bias: BeadBias, layer: int, rng, lag: float, lacking: np.ndarray) -> BeadBias:
    """One layer of a plant with that lag that lacks `lacking` (rows, cols) of the planned height."""
    model = bead_model(zigzag(layer), SIZE, W)
    asked = np.clip(1 + 0.15 * rng.standard_normal(len(model.first)), 0.4, 1.8)
    growth = model.growth(asked, lag) - lacking + 0.03 * rng.standard_normal(SIZE)
    seen = (model.growth(asked, 0.0) > 0) * 1.0
    return bias.learn(layer, model, asked, 0.9 * growth, seen, 0.3)


@pytest.mark.parametrize('lag', [0.0, 1.5e-3])
def test_lag_and_what_is_always_missing_are_learned_per_direction(lag):
    rng, bias = np.random.default_rng(2), BeadBias()
    lacking = [np.zeros(SIZE), np.zeros(SIZE)]
    lacking[0][8:18, 5:7] = 0.3
    for layer in range(1, 13):
        bias = lay(bias, layer, rng, lag, lacking[layer % 2])
    assert bias.lag * W == pytest.approx(lag, abs=0.25e-3)
    here, model = (slice(9, 17), slice(5, 7)), bead_model(zigzag(), SIZE, W)
    assert bias.of(14, model)[here].mean() == pytest.approx(0.9 * 0.3, abs=0.05)
    assert abs(bias.of(13, model)[here].mean()) < 0.05


@pytest.mark.parametrize('lacking', [0.1, 0.3])
def test_what_is_learned_by_place_has_no_level(lacking):
    """A part of a layer lies low, most of it where the layer is thick. All of the metal is as much as the efficiency
    says, so a layer that expects the low places must not be raised by them."""
    model = bead_model(zigzag(), SIZE, W)
    asked, seen, low = np.ones(len(model.first)), np.ones(SIZE), np.zeros(SIZE)
    low[10:24, 10:30] = lacking
    height = np.where(np.arange(SIZE[1]) < 20, 2.0, 1.0) * np.ones(SIZE)
    full = model.growth(asked, 0.0)
    bias = BeadBias().learn(2, model, asked, 0.9 * full - low, seen, 0.3, height=height)
    missing, metal = bias.missing[0], np.where(full > 0.3, height, 0.0)
    assert missing is not None and not bias.missing[1]
    assert (metal * missing).sum() / metal.sum() == pytest.approx(0.0, abs=1e-3)
    inside, outside = np.zeros(SIZE, bool), (full > 0.3) & (low == 0)
    inside[14:20, 14:26] = True
    difference = np.median(missing[inside]) - np.median(missing[outside])
    assert difference == pytest.approx(lacking / 2, rel=0.15), 'one layer counts half'


def test_what_the_ends_of_beads_lack_is_learned_from_all_of_them():
    """Some beads were never seen; what the others lack at their ends is expected there as well."""
    rng, bias, model = np.random.default_rng(3), BeadBias(), bead_model(zigzag(), SIZE, W)
    lacking, seen = np.where((model.end < 0) & (model.end > -6), 0.4, 0.0), np.ones(SIZE)
    seen[:14] = 0.0
    for layer in (2, 4, 6):
        asked = 1 + 0.1 * rng.standard_normal(len(model.first))
        growth = model.growth(asked, 0.0) - lacking + 0.03 * rng.standard_normal(SIZE)
        bias = bias.learn(layer, model, asked, growth, seen, 0.3)
    unseen = (seen == 0) & (model.growth(np.ones(len(model.first)), 0.0) > 0)
    assert bias.of(8, model)[unseen & (lacking > 0)].mean() == pytest.approx(0.4, abs=0.1)
    assert abs(bias.of(8, model)[unseen & (lacking == 0)].mean()) < 0.03


def test_an_efficiency_that_drifts_ahead_of_the_flow_factor_is_expected():
    model, bias = bead_model(zigzag(), SIZE, W), BeadBias()
    asked, seen = np.ones(len(model.first)), np.ones(SIZE)
    growth = model.growth(asked, 0.0)
    for layer in range(1, 30):
        bias = bias.learn(layer, model, asked, 0.93 * growth, seen, 0.3, allowed=0.9)
    assert bias.surplus == pytest.approx(0.93 / 0.9 - 1, abs=1e-3)
    for layer in range(30, 60):
        bias = bias.learn(layer, model, asked, 2 * growth, seen, 0.3, allowed=0.9)
    assert bias.surplus < 0.051
    request = pad(0.75e-3)
    who = Identifier(watch_beads=True)
    who.start('job', 60)
    who.beads.state = bias
    assert who.prepare(request).learned.missing.max() < -0.04


def test_what_cannot_be_compared_teaches_nothing():
    model, bias = bead_model(zigzag(), SIZE, W), BeadBias()
    one = np.ones(len(model.first))
    assert bias.learn(1, model, one, np.ones(SIZE), np.zeros(SIZE), 0.3) is bias
    assert not bias.of(1, model).any()


def test_a_layer_asked_for_twice_counts_once_and_another_job_starts_afresh():
    request = pad(0.75e-3)
    layer = Layer(
        request.z, request.z + np.where(request.footprint, 1.7e-3, 0.0), request.planned, request.resolution, W
    )  # fmt: skip
    once, twice = Identifier(watch_beads=True), Identifier(watch_beads=True)
    for who, times in ((once, 1), (twice, 2)):
        who.start('a', 1)
        who.prepare(request)
        for _ in range(times):
            who.start('a', 2)
            who.add(layer)
    assert once.beads.state.layers == twice.beads.state.layers == (0, 1)
    once.start('b', 1)
    assert once.beads.state.layers == (0, 0)


def test_growth_over_the_inner_cells_ignores_holes():
    request = pad(0.75e-3)
    grid = Resampler.of(request.z.shape, request.resolution, CELL)
    values = np.full(request.z.shape, 0.7)
    values[10:12] = np.nan
    mean, weight = inner_mean(values, np.isfinite(values), request.footprint, grid, 2.0)
    assert mean[weight > 0] == pytest.approx(0.7)
    assert weight.max() == pytest.approx(1.0)


def test_the_beads_are_solved_for_only_when_they_are_told():
    law = make_law('bead_solver', gain=1.0)
    y, x = np.mgrid[: pad(0.75e-3).z.shape[0], : pad(0.75e-3).z.shape[1]]
    told = pad(0.75e-3, error=2e-4 * np.sin(x / 5) * np.cos(y / 4))
    plain = laws.DampedInverse(1.0).correct(told)
    ours, untold = law.correct(told), law.correct(replace(told, paths=()))
    assert (untold.psi == plain.psi).all()
    assert untold.law == 'damped_inverse'
    assert (ours.law, ours.fallback, ours.model_hash) == ('bead_solver', False, '')
    assert np.abs(ours.psi - plain.psi).max() > 0.05
    assert np.abs(ours.psi).max() <= 1
    assert ours.psi.tobytes() == law.correct(told).psi.tobytes()
