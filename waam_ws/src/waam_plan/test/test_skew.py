"""A corrected program lands on the wanted points on a machine whose axes are skewed."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_plan import cli_correct
from waam_plan.gcode.program import gcode
from waam_plan.gcode.skew import AxisErrors, SkewError, angles_from_diagonals
from waam_plan.gcode.skew_program import _Place, correct_gcode
from waam_plan.layers.restore import plan_restoration
from waam_plan.settings import PlanSettings

angle = st.floats(-0.05, 0.05)
scale = st.floats(0.97, 1.03)
number = st.integers(-200_000, 200_000).map(lambda n: n / 1000)
point = st.tuples(number, number, number)


def machine(errors: AxisErrors, commanded: np.ndarray) -> np.ndarray:
    """Where a machine with leaning axes goes: along each real axis by the commanded length. Written independently."""
    a, b, c, d = errors.y_to_x, errors.x_to_y, errors.z_to_x, errors.z_to_y
    out = []
    for x, y, z in commanded:
        x, y, z = x * errors.scale_x, y * errors.scale_y, z * errors.scale_z
        upright = math.sqrt(1 - math.sin(c) ** 2 - math.sin(d) ** 2)
        px = x * math.cos(b) + y * math.sin(a) + z * math.sin(c)
        py = x * math.sin(b) + y * math.cos(a) + z * math.sin(d)
        out.append((px, py, z * upright))
    return np.array(out)


def points_of(text: str) -> np.ndarray:
    """(n, 3) points of the moves of a G-code text, in its units, arcs as chords.

    Absolute moves count from where X, Y and Z are known; relative ones (G91) from an unknown place count from 0.
    """
    place = _Place()
    out: list[np.ndarray] = []
    for number, raw in enumerate(text.split('\n'), 1):
        codes, given = place.read(raw)
        if 92 in codes or not set(given) & set('XYZIJKR'):
            continue
        if place.relative:
            place.wanted = np.nan_to_num(place.wanted)
        corners = place.arc(given, number)
        if corners is not None:
            out.extend(corners[1:])
            continue
        place.go(given)
        if np.isfinite(place.wanted).all():
            out.append(place.wanted.copy())
    return np.array(out).reshape(-1, 3)


def program(points) -> str:
    return '\n'.join(f'G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F600 ; to' for x, y, z in points)


@given(angle, angle, angle, angle, scale, scale, scale, st.lists(point, min_size=1, max_size=8))
def test_exact_correction_hits_every_point(a, b, c, d, sx, sy, sz, points):
    errors = AxisErrors(a, b, c, d, sx, sy, sz)
    commanded = points_of(correct_gcode(program(points), errors.correction))
    assert np.allclose(machine(errors, commanded), np.array(points), atol=2e-4)


@given(st.lists(st.tuples(number, number), min_size=2, max_size=6), angle)
def test_relative_moves_end_where_absolute_ones_do(points, a):
    matrix = AxisErrors(y_to_x=a).correction
    steps = np.diff(np.array([(0.0, 0.0), *points]), axis=0)
    text = 'G91\n' + '\n'.join(f'G1 X{x:.3f} Y{y:.3f}' for x, y in steps)
    moves = []
    for line in correct_gcode(text, matrix).split('\n')[1:]:
        words = dict.fromkeys('XY', 0.0) | {
            w[0]: float(w[1:]) for w in line.split() if w[0] in 'XY'
        }
        moves.append((words['X'], words['Y']))
    end = np.sum(moves, axis=0)
    assert np.allclose(end, (matrix @ [*points[-1], 0.0])[:2], atol=1e-3 * len(points))


def test_a_line_with_one_axis_moves_its_partner_too():
    matrix = AxisErrors(y_to_x=math.radians(1)).correction
    first, second, third = correct_gcode('G0 X10 Y10\nG1 Y60 F300\nG1 Z2', matrix).split('\n')
    assert first.startswith('G0 X') and third == 'G1 Z2.0000'
    x, y = (float(w[1:]) for w in sorted(w for w in second.split() if w[0] in 'XY'))
    assert x == pytest.approx(10 - 60 * math.tan(math.radians(1)), abs=1e-3)
    assert y == pytest.approx(60 / math.cos(math.radians(1)), abs=1e-3)
    assert second.endswith('F300')


def test_everything_else_stays():
    text = 'G21 ; mm X5\n(Y7)\nM3\nW5000 S22\nG53 X0 Y0\nM30\n'
    assert correct_gcode(text, AxisErrors(y_to_x=0.01).correction) == text
    moved = correct_gcode('G1 (to X9) X1 (Y9) Y0 ; X9', AxisErrors(x_to_y=0.01).correction)
    assert re.fullmatch(r'G1 \(to X9\) X1\.\d+ \(Y9\) Y-0\.01\d+ ; X9', moved)


def test_what_frames_a_cam_program_stays_and_an_optional_block_is_bent():
    """As in the controller: '%' says nothing, and a block behind '/' is executed."""
    text = '%\nG17 G40 G49 G80 G64 P0.01\nG0 X0 Y0\n/G1 X0 Y10 M8\nM9 M30\n%\n'
    before, after = text.split('\n'), correct_gcode(text, AxisErrors(y_to_x=0.1).correction)
    lines = after.split('\n')
    assert [i for i, line in enumerate(lines) if line != before[i]] == [2, 3]
    assert re.fullmatch(r'/G1 X-1\.\d+ Y10\.\d+ M8', lines[3])


def test_settings_of_a_printer_and_messages_are_no_places():
    """Headers of slicers: they stay, and the place stays what it was."""
    text = 'G0 X10 Y20\nM201 X1000 Y900\nM205 X8 Y8\nM92 X80 Y80\nM117 at X9 Y9\nN3 M117 X1\nG4 X1.5\nM862.3 P1'
    before, after = text.split('\n'), correct_gcode(text, AxisErrors(y_to_x=0.1).correction)
    assert after.split('\n')[1:] == before[1:]
    further = correct_gcode(text + '\nG1 Y30 F60', AxisErrors(y_to_x=0.1).correction)
    straight = correct_gcode('G0 X10 Y20\nG1 Y30 F60', AxisErrors(y_to_x=0.1).correction)
    assert further.split('\n')[-1] == straight.split('\n')[-1]


@given(st.text(alphabet='GXYZIJEFM0123456789.-+ #[]*;()\n', max_size=60))
def test_any_text_is_corrected_or_refused_with_its_line(text):
    """Nothing but SkewError, and what is corrected with nothing to correct says the same."""
    try:
        corrected = correct_gcode(text, AxisErrors().correction)
    except SkewError as e:
        assert re.match(r'line \d+: ', str(e))
    else:
        if not re.search('G0*[23]', text):
            before, after = points_of(text), points_of(corrected)
            assert np.allclose(after, before, atol=1e-4 * (1 + len(before)))


LEANING = AxisErrors(y_to_x=0.004, z_to_x=0.01, z_to_y=-0.007, scale_z=1.01)


def test_a_first_rapid_lifts_only_and_the_next_one_puts_the_torch_right():
    lift, way, down = correct_gcode('G0 Z16\nG0 X3 Y4\nG1 Z2 F60', LEANING.correction).split('\n')
    upright = LEANING.axes[2, 2]
    assert lift == f'G0 Z{16 / upright:.4f}'
    assert sorted(w[0] for w in way.split()[1:]) == ['X', 'Y']
    x, y = (float(w[1:]) for w in way.split()[1:])
    assert LEANING.axes @ (x, y, 16 / upright) == pytest.approx((3, 4, 16), abs=2e-4)
    z, x, y = (float(w[1:]) for w in down.split()[1:4])
    assert LEANING.axes @ (x, y, z) == pytest.approx((3, 4, 2), abs=2e-4)


@pytest.mark.parametrize(
    'text',
    [
        'G1 Z16 F600',  # no rapid
        'G0 X3 Y4',  # these depend on Z
        'G0 Z16\nG1 X3 Y4 F600\nG28\nG1 Z2',  # unknown again
    ],
)
def test_where_z_leans_everything_else_before_the_place_is_known_is_refused(text):
    with pytest.raises(SkewError, match=rf'line {len(text.splitlines())}: X depends on .*G0 Z'):
        correct_gcode(text, LEANING.correction)


@pytest.mark.parametrize('lead_on', [0.0, 0.5])
def test_programs_of_the_post_can_be_corrected(worn_block, lead_on):
    plan = plan_restoration(*worn_block(0.003), PlanSettings(lead_on=lead_on))
    text = gcode(plan)
    commanded = points_of(correct_gcode(text, LEANING.correction))
    wanted = points_of(text)
    assert len(wanted) > 100 and len(commanded) == len(wanted)
    assert machine(LEANING, commanded) == pytest.approx(wanted, abs=2e-4)


def test_points_follow_relative_moves():
    text = 'G0 Z5\nG0 X10 Y20\nG91\nG1 X1 Y-2\nG1 Z3\nG90 G1 X0\nG91 G1 X4'
    expected = [(10, 20, 5), (11, 18, 5), (11, 18, 8), (0, 18, 8), (4, 18, 8)]
    assert points_of(text).tolist() == [list(p) for p in expected]
    assert points_of('G91\nG1 X1\nG1 X1 Y2').tolist() == [[1, 0, 0], [2, 2, 0]]
    away = 'G0 X1 Y2 Z3\nG10 L2 P1 X50\nG53 G0 X0 Y0\nG1 X7\nG1 Y8 Z9'
    assert points_of(away).tolist() == [[1, 2, 3], [7, 8, 9]]


@given(st.lists(point, min_size=2, max_size=6))
def test_picture_of_a_relative_program_is_that_of_the_absolute_one(points):
    first, steps = points[0], np.diff(points, axis=0)
    text = program([first]) + '\nG91\n' + program(steps)
    assert points_of(text) == pytest.approx(np.array(points), abs=1e-9)
    corrected = correct_gcode(text, LEANING.correction)
    real = machine(LEANING, points_of(corrected))
    assert real == pytest.approx(np.array(points), abs=2e-4 * len(points))


@pytest.mark.parametrize(
    ('text', 'what'),
    [
        ('G0 X0 Y0 Z1\nG2 X1 Y1 I7 J0', 'line 2: radius mismatch'),
        ('G0 X0 Y0\nG2 X1 Y1 I1', 'line 2: the arc begins'),
        ('G0 X1', 'depends on Y'),
        ('G92 X0', 'G92'),
        ('G0 X0 Y0\nG1 X1e-05', 'line 2: X: an exponent'),
        ('G0 X1 Y1\nG28\nG1 X5', 'line 3'),
        ('G0 X0 Y0\nG77 X20', 'line 2: G77: is no move'),
        ('G0 X0 Y0\nG81 X1 Y2 Z-3 R1', 'line 2: G81: is no move'),
        ('G0 X0 Y0\nG5 X1 Y2 I1 J1 P0 Q0', 'line 2: G5: is no move'),
        ('G52 X5', 'line 1: G52: is no move'),
        ('G0 X0 Y0\nG2 X10 Y0 I5..2 J0 E1', r'line 2: \.2: cannot be read'),
        ('G0 X0 Y0\nG1 X5 ?', r'line 2: \?: cannot be read'),
        ('G0 X0 Y0\nG1 X1*57', r'line 2: \*57: cannot be read'),
        ('G0 X0 Y0\nG1 X[#1+2] Y3', r'line 2: X\[#1\+2\]: is computed'),
        ('G0 X0 Y0\nX#5', 'line 2: X#5: is computed'),
    ],
)
def test_what_cannot_be_corrected_is_named(text, what):
    with pytest.raises(SkewError, match=what):
        correct_gcode(text, AxisErrors(y_to_x=0.01).correction)


@pytest.mark.parametrize('frame', ['', 'G91 ', 'G20 ', 'G90.1 '])
def test_an_arc_becomes_lines_that_a_skewed_machine_drives_as_the_arc(frame):
    unit = 25.4 if 'G20' in frame else 1.0
    start = 'G0 Z2\nG0 X30 Y20\n'
    centre = 'I40 J20' if '90.1' in frame else 'I10'
    end = 'X20 Y0' if 'G91' in frame else 'X50 Y20'  # the same place
    text = f'{start}N5 {frame}G3 {end} {centre} E7 F600 ; half\nG90 G1 X0 Y0 Z2'
    corrected = correct_gcode(text, LEANING.correction)
    lines = corrected.split('\n')[2:]
    assert lines[0].startswith('N5') and 'F600' in lines[0] and lines[0].endswith('; half')
    assert all('G1 X' in line and 'I' not in line for line in lines)
    real = machine(LEANING, points_of(corrected))[1:-1]
    middle = np.array([40, 20])
    assert np.abs(np.linalg.norm(real[:, :2] - middle, axis=1) - 10).max() * unit < 2e-2
    assert real[-1] == pytest.approx((50, 20, 2), abs=2e-2)


@pytest.mark.parametrize('kind', ['scale_x', 'y_to_x'])
def test_nonsense_calibration_is_refused(kind):
    with pytest.raises(SkewError, match=kind):
        AxisErrors(**{kind: 0.5})


@given(st.floats(50, 500), st.floats(50, 500), angle)
def test_angle_from_the_diagonals_of_a_rectangle(x, y, a):
    corner = np.array([x + y * math.sin(a), y * math.cos(a)])
    other = np.array([x - y * math.sin(a), -y * math.cos(a)])
    found = angles_from_diagonals(x, y, float(np.linalg.norm(corner)), float(np.linalg.norm(other)))
    assert found == pytest.approx(a, abs=1e-9)


def test_diagonals_of_no_parallelogram_are_refused():
    with pytest.raises(SkewError, match='measure again'):
        angles_from_diagonals(100, 100, 150, 141)


def test_command_line_writes_the_program(tmp_path, capsys):
    import argparse

    parser = argparse.ArgumentParser()
    cli_correct.register(parser.add_subparsers())
    source, out = tmp_path / 'a.gcode', tmp_path / 'b.gcode'
    source.write_text(program([(0, 0, 5), (100, 0, 5), (100, 80, 5), (0, 80, 5), (0, 0, 5)]))
    args = parser.parse_args(['correct', str(source), '--y-to-x', '0.3', '--out', str(out)])
    assert args.run_command(args) == 0
    real = machine(AxisErrors(y_to_x=math.radians(0.3)), points_of(out.read_text()))
    assert np.abs(real - points_of(source.read_text())).max() < 2e-4
    args = parser.parse_args(['correct', str(source), '--y-to-x', '30', '--out', str(out)])
    assert args.run_command(args) == 2 and 'y_to_x' in capsys.readouterr().err
