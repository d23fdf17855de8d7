"""Plans of shafts: the seam, the metal, the run-out, and what is refused."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from waam_plan import cli
from waam_plan.layers.restore import plan_restoration
from waam_plan.plan import metal_of
from waam_plan.settings import PlanSettings, SettingsError
from waam_plan.shaft import run_out
from waam_plan.shaft.lines import arc_paths
from waam_plan.shaft.revolution import body_of
from waam_plan.shaft.surfaces import of_file
from waam_process.grid import GridSpec, HeightGrid
from waam_process.unrolled import OVERLAP, ShaftError, Unrolled

D, LENGTH, ENDS = 0.050, 0.080, 0.016
S = PlanSettings(
    shaft_diameter=D, shaft_ends=ENDS, machine_min=(-1.0, -0.1, -0.1), machine_max=(2.0, 0.3, 0.3)
)
SHAFT = Unrolled(D)


def write(path, wear, centre=(0.0, 0.0), tilt=(0.0, 0.0), noise=0.0):
    """A map of one turn. wear(t, y): m that are missing at angle t (rad) and y (m) between the ends."""
    cols = round(math.pi * D / 0.5e-3)
    cell = math.pi * D / cols
    spec = GridSpec(0.0, 0.0, cell, int(LENGTH / cell), cols)
    t, y = np.meshgrid(spec.x / (D / 2), spec.y)
    zone = (y > ENDS) & (y < LENGTH - ENDS)
    away = y - LENGTH / 2
    ex, ey = (centre[k] + tilt[k] * away for k in (0, 1))
    z = ex * np.cos(t) + ey * np.sin(t) - np.where(zone, wear(t, y), 0.0)
    z = z + np.random.default_rng(1).normal(0.0, noise, z.shape)
    HeightGrid(spec, z).save_npz(path)
    return path


def planned(path, settings=S):
    found, nominal, out = of_file(path, 1e-3, settings)
    return plan_restoration(found, nominal, settings), out


def eccentric(t, y):
    return 1.8e-3 + 0.8e-3 * np.cos(t - 1.0)


@pytest.fixture
def all_round(tmp_path):
    return planned(write(tmp_path / 'worn.npz', eccentric))[0]


def test_lines_are_evenly_divided_over_the_turn(tmp_path):
    along = replace(S, strategy='zigzag')
    last = planned(write(tmp_path / 'worn.npz', eccentric), along)[0].layers[-1]
    inner = [s.midpoint[0] for s in last.deposits if abs(s.midpoint[1] - LENGTH / 2) < 8e-3]
    x = np.unique(np.round(inner, 6))
    lines = x[np.concatenate([[True], np.diff(x) > 1e-4])]
    gaps = np.diff(np.concatenate([lines, [lines[0] + SHAFT.period]]))
    assert len(lines) == math.ceil(SHAFT.period / S.pitch)
    assert (
        gaps.max() - gaps.min() < 0.6e-3
    )  # a cell: the last one meets the first as all others meet


def test_the_metal_is_that_of_the_ring(tmp_path):
    plan, _ = planned(write(tmp_path / 'worn.npz', lambda t, y: 2e-3 + 0 * t))
    wanted = math.pi * ((D / 2) ** 2 - (D / 2 - 2e-3) ** 2) * (LENGTH - 2 * ENDS)
    laid = sum(metal_of(layer, plan.spec, plan.settings) for layer in plan.layers)
    assert laid == pytest.approx(wanted, rel=0.06)
    assert plan.volume == pytest.approx(laid, rel=0.04)


@pytest.mark.parametrize('strategy', ['solid', 'zigzag'])
def test_beads_at_the_seam_carry_what_the_others_carry(tmp_path, strategy):
    worn = write(tmp_path / 'worn.npz', lambda t, y: 1.5e-3 + 0 * t)
    plan, _ = planned(worn, replace(S, strategy=strategy))
    for layer in plan.layers:
        inner = [s for s in layer.deposits if abs(s.midpoint[1] - LENGTH / 2) < 8e-3]
        rows = [(SHAFT.folded(s.midpoint[0]), s.height) for s in inner]
        x, h = np.array(rows).T
        beside = (x < OVERLAP + 4e-3) | (x > OVERLAP + SHAFT.period - 4e-3)
        assert h[beside].mean() == pytest.approx(h[~beside].mean(), rel=0.02)


def test_turning_the_wear_turns_the_plan(tmp_path):
    plans = []
    for k, angle in enumerate((0.0, 2.0)):
        plan, _ = planned(write(tmp_path / f'{k}.npz', lambda t, y, a=angle: eccentric(t - a, y)))
        plans.append(plan)
    volumes = [p.volume for p in plans]
    assert len(plans[0].layers) == len(plans[1].layers)
    assert volumes[1] == pytest.approx(volumes[0], rel=0.01)


@pytest.mark.parametrize('angle', [0.0, math.pi])  # over the seam, and opposite
def test_a_sector_is_filled_wherever_it_lies(tmp_path, angle):
    def sector(t, y):
        return 2e-3 * (np.abs((t - angle + math.pi) % (2 * math.pi) - math.pi) < 0.6)

    plan, _ = planned(write(tmp_path / 'worn.npz', sector))
    wanted = 2e-3 * 1.2 * (D / 2 - 1e-3) * (LENGTH - 2 * ENDS)
    assert plan.layers and plan.volume == pytest.approx(wanted, rel=0.25)
    for layer in plan.layers:
        for s in layer.deposits:
            off = (SHAFT.angle(s.midpoint[0]) - angle + math.pi) % (2 * math.pi) - math.pi
            assert abs(off) < 0.75


def test_each_place_counts_once(all_round):
    first = SHAFT.first_turn(all_round.spec)
    assert not all_round.region[:, ~first].any() and all_round.region[:, first].any()
    assert not all_round.interior[:, ~first].any()
    assert all_round.layers[-1].planned[:, ~first].any()  # the correction looks over the seam


def test_the_correction_is_told_the_neighbours_over_the_seam(all_round):
    paths = arc_paths(all_round.layers[-1], all_round.settings)
    own = all_round.layers[-1].arc_paths
    assert len(paths) > len(own)
    x = np.concatenate([p[:, 0] for p in paths])
    assert x.min() < OVERLAP - 10e-3 and x.max() > OVERLAP + SHAFT.period + 10e-3
    laid = SHAFT.folded(np.concatenate(own)[:, 0])
    for p in paths:  # every one is a stretch of an own path, some turns aside
        away = np.abs(SHAFT.folded(p[:, 0])[:, None] - laid[None])
        y = np.abs(p[:, 1, None] - np.concatenate(own)[None, :, 1])
        assert (np.minimum(away, SHAFT.period - away) + y).min(axis=1).max() < 1e-9


def test_run_out_is_found_and_taken_out(tmp_path):
    centre, tilt = (0.35e-3, -0.20e-3), (2e-3, 1e-3)
    worn = write(tmp_path / 'worn.npz', eccentric, centre, tilt, noise=3e-5)
    plan, out = planned(worn)
    straight, _ = planned(write(tmp_path / 'straight.npz', eccentric))
    assert np.allclose(out.centre(LENGTH / 2), centre, atol=0.02e-3)
    assert np.hypot(*np.subtract((out.cos[1], out.sin[1]), tilt)) < 0.5e-3
    assert 0.0 < out.sigma < 0.02e-3
    assert plan.volume == pytest.approx(straight.volume, rel=0.03)


def test_the_told_uncertainty_is_that_of_many_scans(tmp_path):
    off, told = [], []
    for seed in range(40):
        spec = GridSpec(0.0, 0.0, 0.5e-3, 160, round(SHAFT.length_x / 0.5e-3))
        z = SHAFT.level + np.random.default_rng(seed).normal(0.0, 2e-4, spec.shape)
        out = run_out.fit(HeightGrid(spec, z), SHAFT, ENDS, LENGTH)
        off.append(out.centre(LENGTH / 2)[0])
        told.append(out.sigma)
    assert 0.6 < np.std(off) / np.mean(told) < 1.6


@pytest.mark.parametrize(
    ('spoil', 'said'),
    [
        (lambda z, y, t: z - 0.8e-3 * np.cos(3 * t), 'not round'),
        (lambda z, y, t: z - 1.0e-3, 'have a diameter of 48.00 mm'),
        (lambda z, y, t: np.where((y < ENDS) & (t < 2.5), np.nan, z), 'of the unworn end'),
    ],
)
def test_ends_that_do_not_show_the_axis_are_refused(spoil, said):
    spec = GridSpec(0.0, 0.0, 0.5e-3, 160, round(SHAFT.length_x / 0.5e-3))
    t, y = np.meshgrid(SHAFT.angle(spec.x), spec.y)
    with pytest.raises(ShaftError, match=said):
        run_out.fit(
            HeightGrid(spec, spoil(np.full(spec.shape, SHAFT.level), y, t)), SHAFT, ENDS, LENGTH
        )


def test_short_ends_are_refused(tmp_path):
    with pytest.raises(ShaftError, match='unworn ends are 5 mm of'):
        planned(write(tmp_path / 'worn.npz', eccentric), replace(S, shaft_ends=5e-3))


@pytest.mark.parametrize(
    ('changed', 'said'),
    [
        ({'strategy': 'contour'}, 'strategy is contour'),
        ({'alternation': 'turn'}, 'alternation is turn'),
        ({'tilt_deg': 10.0}, 'tilt_deg is 10'),
        ({'stagger': True}, 'stagger is True'),
        ({'shrinkage': 0.01}, 'only a build knows this'),
        ({'shaft_diameter': 0.02}, 'thinner than 0.03 m'),
        ({'shaft_diameter': 0.0}, 'shaft_ends belongs to a shaft'),
    ],
)
def test_settings_that_do_not_go_with_a_shaft(changed, said):
    with pytest.raises(SettingsError, match=said):
        replace(S, **changed)


def test_a_cloud_of_a_turn(tmp_path):
    t, y = np.meshgrid(np.linspace(0, 2 * np.pi, 900, endpoint=False), np.linspace(0, LENGTH, 320))
    zone = (y > ENDS) & (y < LENGTH - ENDS)
    r = D / 2 - np.where(zone, eccentric(t, y), 0.0)
    points = np.column_stack([(r * np.sin(t)).ravel(), y.ravel(), (r * np.cos(t)).ravel()])
    np.savetxt(tmp_path / 'scan.xyz', points * 1e3, fmt='%.4f')
    from_cloud, out = planned(tmp_path / 'scan.xyz')
    from_map, _ = planned(write(tmp_path / 'worn.npz', eccentric))
    assert out.eccentricity < 0.02e-3
    assert from_cloud.volume == pytest.approx(from_map.volume, rel=0.03)


def test_files_that_show_another_shaft_are_refused(tmp_path):
    worn = write(tmp_path / 'worn.npz', eccentric)
    with pytest.raises(ShaftError, match='one turn of 80 mm is 251.3 mm'):
        planned(worn, replace(S, shaft_diameter=0.08))
    mesh = tmp_path / 'worn.stl'
    mesh.write_text('solid')
    with pytest.raises(ShaftError, match='not a mesh'):
        planned(mesh)


def test_bodies_of_revolution_are_told():
    lying = trimesh.creation.cylinder(0.02, 0.1, sections=64)
    lying.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    lying.apply_translation((0.3, 0.1, 0.02))
    body = body_of(lying)
    assert body is not None and abs(body.axis[0]) == 1.0
    assert body.diameter == pytest.approx(0.04, rel=1e-3) and body.length == pytest.approx(0.1)
    assert body_of(trimesh.creation.box((0.04, 0.04, 0.1))) is None
    assert body_of(trimesh.creation.cylinder(0.02, 0.1, sections=6)) is None


def waam(*words):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(required=True))
    args = parser.parse_args(['plan', *map(str, words)])
    return args.run_command(args)


def test_the_command_plans_a_shaft(tmp_path, capsys):
    worn = write(tmp_path / 'worn.npz', eccentric, (0.3e-3, 0.0))
    assert waam(worn, '--shaft', 50, '--ends', 16, '--out', tmp_path / 'out') == 0
    said = capsys.readouterr().out
    assert 'run-out of the unworn ends: the axis lies 0.300' in said
    assert f'waam forecast {worn} --shaft 50 --ends 16' in said
    assert (tmp_path / 'out' / 'program.gcode').stat().st_size > 1000


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('--shaft', 50), 'needs --ends'),
        (('--ends', 16), '--ends belongs to --shaft'),
        (('--shaft', 50, '--ends', 16, '--machine', 'robot'), 'not built'),
        (('--shaft', 50, '--ends', 16, '--as-found', 'x.npz'), 'PART is the scan'),
        (('--shaft', 50, '--ends', 16, '--post', 'kuka'), 'not with --shaft'),
    ],
)
def test_the_command_refuses(tmp_path, capsys, words, said):
    worn = write(tmp_path / 'worn.npz', eccentric)
    assert waam(worn, *words) == 2
    assert said in capsys.readouterr().err


def test_a_lying_roller_is_told(tmp_path, capsys):
    lying = trimesh.creation.cylinder(10, 40, sections=64)
    lying.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    lying.export(tmp_path / 'roller.stl')
    waam(tmp_path / 'roller.stl', '--layers', 1, '--set', 'overhang=flag')
    said = capsys.readouterr().out
    assert (
        'body of revolution: its axis lies along x, largest diameter 20.0 mm, length 40.0 mm'
        in said
    )
    assert '--shaft 20 --ends MM' in said
