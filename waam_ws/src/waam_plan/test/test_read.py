"""The reader of G-code: its path is the program's, what cannot be meant is refused with line and word."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from waam_plan.import_gcode.dialect import DialectError, dialect_of
from waam_plan.import_gcode.files import (
    load_dialect,
    load_program,
    parse_dialect,
    program_text,
    shipped,
)
from waam_plan.import_gcode.motion import CHORD, Motion
from waam_plan.import_gcode.reader import read_program
from waam_plan.import_gcode.words import ProgramError

OURS, SLICER, WELDER = (load_dialect(name) for name in ('waam', 'slicer', 'welder'))
LIT = 'G0 Z5\nG0 X0 Y0\nG1 Z0 F600\nW6000 S22\nM3\n'


def read(text: str, dialect=OURS) -> list[Motion]:
    return read_program(text, dialect).motions


def laid(text: str, dialect=OURS) -> list[Motion]:
    return [m for m in read(text, dialect) if m.arc]


# ---- what is meant ----


def test_path_speed_wire_and_voltage_of_our_own_words():
    first, second = laid(f'{LIT}G1 X10 F600\nW7000 S23\nG1 Y5\nM5')
    assert (first.start, first.end) == ((0, 0, 0), (0.01, 0, 0))
    assert (first.speed, first.wire, first.voltage) == pytest.approx((0.01, 0.1, 22))
    assert (second.end, second.line) == ((0.01, 0.005, 0), 8)
    assert (second.wire, second.voltage) == pytest.approx((7 / 60, 23))


def test_units_distance_modes_and_shifts():
    text = f'{LIT}G20 G91\nG1 X1 F60\nG1 X1\nG90 G92 X0\nG1 X-1\nG92.1\nG21\nG1 X10\nM5'
    x = [m.end[0] for m in laid(text)]
    assert x == pytest.approx([0.0254, 0.0508, 0.0254, 0.01])
    assert laid(text)[0].speed == pytest.approx(0.0254)


@pytest.mark.parametrize(
    'arc',
    [
        'G2 X10 Y0 I5 J0',
        'G2 X10 Y0 I5',
        'G2 X10 R5',
        'G90.1 G2 X10 Y0 I5 J0',
        'G91 G2 X10 I5',
        'G17 G3 X10 Y0 I5 J0',
        'G3 X10 Y0 R5',
    ],
)
def test_half_a_circle_in_all_its_forms(arc):
    (m,) = laid(f'{LIT}{arc} F600\nM5')
    middle = m.round.at(np.array([0.5]))[0]
    assert middle == pytest.approx((0.005, 0.005 if 'G2' in arc else -0.005, 0), abs=1e-12)
    assert m.length == pytest.approx(math.pi * 0.005)


def test_helix_whole_turns_and_other_planes():
    (helix,) = laid(f'{LIT}G3 X0 Y0 Z6 I5 P3 F600\nM5')
    assert helix.round.sweep == pytest.approx(6 * math.pi)
    assert helix.length == pytest.approx(math.hypot(6 * math.pi * 0.005, 0.006))
    (upright,) = laid(f'{LIT}G18 G2 X10 Z0 I5 K0 F600\nM5')
    assert upright.round.at(np.array([0.5]))[0] == pytest.approx((0.005, 0, -0.005), abs=1e-12)
    (side,) = laid(f'{LIT}G19 G3 Y10 Z0 J5 K0 F600\nM5')
    assert side.round.at(np.array([0.5]))[0] == pytest.approx((0, 0.005, -0.005), abs=1e-12)


def test_wire_of_an_extruder_absolute_and_relative():
    text = (
        'G21\nG90\nM82\nG28\nG92 E0\nG1 Z2 F3000\nG1 X0 Y0\nG1 F600\nG1 X10 E70\nG1 E68 F2400\n'
        'G1 X20 F3000\nG1 E70\nG1 X30 E140 F600\nM83\nG1 X40 E35\nG92 E0\nM104 S0\n'
    )
    program = read_program(text, SLICER)
    first, second, third = program.burning
    assert [m.wire for m in (first, second, third)] == pytest.approx([0.07, 0.07, 0.035])
    assert first.speed == pytest.approx(0.01) and second.start[0] == pytest.approx(0.02)
    assert program.remarks == ['G28 is left to the job (first in line 4)']
    assert read_program(text + 'G28 X0 U0\n', SLICER).burning == program.burning
    assert program.height == 'top' and program.idle == 'lift'


def test_a_printer_goes_idle_at_its_own_speed_until_a_feed_is_told():
    head = 'G21\nG90\nM83\nG28\n'
    up, across, bead = read(f'{head}G1 Z10\nG1 X5 Y5\nG1 X15 E1 F600\n', SLICER)
    assert (up.rapid, across.rapid, bead.rapid) == (True, True, False)
    assert bead.arc and bead.speed == pytest.approx(10e-3)
    with pytest.raises(ProgramError, match='line 5: X15: no feed'):
        read(f'{head}G1 X15 E1', SLICER)


def test_wire_by_other_words():
    (m,) = laid('G0 Z0\nG0 X0 Y0\nM3 S4800\nG1 X10 F600\nM5', WELDER)
    assert m.wire == pytest.approx(0.08) and m.voltage == 0
    linked = parse_dialect(
        'arc_on: M64 P0\narc_off: M65 P0\nwire: {code: M700, word: P, unit: mm/mm}\n'
        'voltage: {code: M67 E1, word: Q}',
        'linked',
    )
    text = 'G0 X0 Y0 Z0\nM700 P7\nM67 E1 Q21.5\nM64 P0\nG1 X10 F600\nF300\nX20\nM65 P0'
    fast, slow = laid(text, linked)
    assert (fast.wire, slow.wire) == pytest.approx((0.07, 0.035))
    assert fast.voltage == 21.5


def test_comments_numbers_deleted_blocks_and_check_sums():
    line = 'N30 G1 X10'
    check = reduce(lambda a, b: a ^ b, line.encode(), 0)
    text = f'%\nN10 (M3) g0z5;M3\n{LIT}{line}*{check}\n/G1 X20 (half way) Y5 ; on\nN50 M5\n%\n'
    assert [m.end[0] for m in laid(text)] == pytest.approx([0.01, 0.02])
    skipping = dialect_of({'arc_on': 'M3', 'arc_off': 'M5', 'block_delete': True}, 'here')
    assert len(laid('G0 X0 Y0 Z0 F600\nM3\nG1 X10\n/G1 X20\nM5', skipping)) == 1


def test_a_dwell_burns_while_the_arc_is_on():
    wait, _, rest = [m for m in read(f'{LIT}G4 P0.5\nG1 X10\nM5\nG4 P3') if m.dwell or m.arc]
    assert (wait.dwell, wait.arc, wait.wire) == (0.5, True, pytest.approx(0.1))
    assert (rest.dwell, rest.arc) == (3, False)


@pytest.mark.parametrize('name', ['cura_pad', 'slic3r_pad', 'prusaslicer_pad', 'prusaslicer_disc'])
def test_programs_of_slicers_are_read_and_their_metal_is_that_of_the_part(programs, name):
    """Debian's CuraEngine 4.13, Slic3r 1.3 and PrusaSlicer 2.5 with one setting: wire of 1.2 mm, flow 1.087."""
    program = load_program(programs / f'{name}.gcode', 'slicer')
    burning = program.burning
    wire = sum(m.wire * m.length / m.speed for m in burning)
    metal = wire * math.pi * 0.6e-3**2 * 0.92
    part = {'pad': 48 * 28 * 8e-9, 'disc': math.pi * 18**2 * 6e-9}[name.split('_')[1]]
    assert metal == pytest.approx(part, rel=0.3 if name == 'cura_pad' else 0.12)
    assert all(m.speed == pytest.approx(0.01) for m in burning)


# ---- exactness ----


@st.composite
def arc_cases(draw):
    """Start, centre, angle and rise of an arc in 1e-4 mm, as a program writes them."""
    radius = draw(st.floats(0.5, 150))
    a0, sweep = draw(st.floats(-math.pi, math.pi)), draw(st.floats(0.05, 6.2))
    left, rise = draw(st.booleans()), draw(st.floats(-5, 5))
    x, y = draw(st.floats(-100, 100)), draw(st.floats(-100, 100))
    return radius, a0, sweep, left, rise, x, y


@given(arc_cases())
@settings(max_examples=60, deadline=None)
def test_chords_lie_within_the_stated_tolerance_of_the_exact_arc(case):
    """Against an evaluation of its own: the distance of the chords' points from circle and helix."""
    radius, a0, sweep, left, rise, x, y = case
    turn = sweep if left else -sweep
    start = (x + radius * math.cos(a0), y + radius * math.sin(a0))
    end = (x + radius * math.cos(a0 + turn), y + radius * math.sin(a0 + turn))
    text = (
        f'G0 Z0\nG0 X{start[0]:.5f} Y{start[1]:.5f}\nW6000\nM3\n'
        f'{"G3" if left else "G2"} X{end[0]:.5f} Y{end[1]:.5f} Z{rise:.5f} '
        f'I{x - start[0]:.5f} J{y - start[1]:.5f} F600\nM5'
    )
    (m,) = laid(text)
    corners = m.corners() * 1e3
    points = np.vstack([corners, 0.5 * (corners[:-1] + corners[1:])])
    off = np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - radius)
    assert off.max() <= CHORD * 1e3 + 3e-5  # the words have five decimals
    angle = (np.arctan2(points[:, 1] - y, points[:, 0] - x) - a0) * (1 if left else -1)
    share = np.mod(angle + 1e-3, 2 * math.pi) - 1e-3
    rounding = 3e-5 / radius / sweep  # of the words, as a share of the arc
    assert points[:, 2] == pytest.approx(rise * share / sweep, abs=2e-4 + abs(rise) * rounding)


@given(
    st.lists(st.tuples(*[st.integers(-200_000, 200_000)] * 2), min_size=2, max_size=12),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_round_trip_of_any_chain_in_all_modes(points, relative, inch):
    unit = 25.4 if inch else 1.0
    text = [f'{"G20" if inch else "G21"} G90', 'G0 Z0', 'W6000', 'F600']
    at = points[0]
    text += [f'G0 X{at[0] / 1e3:.3f} Y{at[1] / 1e3:.3f}', 'M3']
    text += ['G91'] * relative
    for p in points[1:]:
        x, y = (p[i] - at[i] if relative else p[i] for i in (0, 1))
        text.append(f'G1 X{x / 1e3:.3f} Y{y / 1e3:.3f}')
        at = p
    moves = [p for a, p in zip(points, points[1:], strict=False) if a != p]
    if not moves:
        return
    got = laid('\n'.join([*text, 'M5']))
    assert [m.end[:2] for m in got] == [
        pytest.approx((p[0] * unit * 1e-6, p[1] * unit * 1e-6), abs=1e-9) for p in moves
    ]


# ---- what must fail ----

BAD = {
    'arc never put out': (LIT + 'G1 X10', r'line 5: the arc .* never put out'),
    'ended with the arc on': (LIT + 'G1 X10\nM30', None),
    'radius mismatch': (LIT + 'G2 X10 Y0 I4 J0\nM5', 'line 6: G2: radius mismatch'),
    'radius too small': (LIT + 'G2 X10 R4\nM5', 'line 6: G2: radius mismatch'),
    'no centre': (LIT + 'G2 X10\nM5', 'line 6: G2: an arc needs I and J, or R'),
    'absolute centre without J': (LIT + 'G90.1 G2 X10 I5\nM5', 'line 6: G2: an arc needs'),
    'R without a way': (LIT + 'G2 R5\nM5', 'line 6: G2: an arc by its radius'),
    'R and a centre': (LIT + 'G2 X10 R5 I5\nM5', 'line 6: G2: R and a centre'),
    'centre of another plane': (LIT + 'G2 X10 I5 K3\nM5', 'line 6: K3: has no meaning'),
    'part of a turn': (LIT + 'G2 X10 I5 P1.5\nM5', 'line 6: P1.5: whole turns'),
    'unknown G': (LIT + 'G77 X1\nM5', 'line 6: G77: means nothing'),
    'spline': ('G5 X1', 'line 1: G5: splines'),
    'inverse time': ('G93', 'line 1: G93: .*G94'),
    'cutter compensation': ('G41 D1', 'line 1'),
    'work zero': ('G10 L2 P1 X0', 'line 1: G10'),
    'other work zero': ('G55', 'line 1: G55: there is one work zero'),
    'unknown M': ('M77', 'line 1: M77: means nothing in dialect waam'),
    'of a slicer': ('M83', 'M83: means nothing in dialect waam; a program of a slicer\\? Then'),
    'stop': (LIT + 'M0', 'line 6: M0: a job does not stop'),
    'not a number': (LIT + 'G1 XNAN', "line 6: XNAN: cannot be read"),
    'infinite': (LIT + f'G1 X{"9" * 400}', 'line 6: X9+\\.\\.\\.: beyond'),
    'very far': (LIT + 'G1 X99999\nM5', 'line 6: X99999: 100 m away'),
    'exponent': (LIT + 'G1 X1e-5\nM5', 'line 6: X1e-5: an exponent'),
    'parameter': ('#1=5', 'line 1: #1=5: cannot be read'),
    'expression': ('G1 X[1+2]', r'line 1: X\[1\+2\]: cannot be read'),
    'macro': ('o100 call', 'line 1'),
    'word without number': (LIT + 'G1 X', 'line 6: X: cannot be read'),
    'arc on at a rapid': (LIT + 'G0 X10\nM5', r'line 6: X10: a rapid .* lit in line 5'),
    'no feed': ('G0 Z0\nG0 X0 Y0\nW60 M3\nG1 X10\nM5', 'line 4: X10: no feed'),
    'feed 0': ('F0', 'line 1: F0: a feed must be above 0'),
    'feed below 0': ('G1 X1 F-5', 'line 1: F-5'),
    'no wire': ('G0 X0 Y0 Z0\nM3\nG1 X1 F600\nM5', 'line 3: X1: the arc is on, but no wire'),
    'wire below 0': ('W-5', 'line 1: W-5: must not be negative'),
    'unknown place': ('W60 M3\nG1 X1 Y1 F600\nM5', 'line 2: X1: .*where X is'),
    'arc from an unknown place': ('G0 X0\nG2 X1 I1 F60', 'line 2: G2: .*not known'),
    'a move of an axis that is not there': (LIT + 'M5\nG53 G0 U0', 'line 7: U0: has no meaning'),
    'machine zero with the arc on': (LIT + 'G28', 'line 6: G28: moves in machine coordinates'),
    'G92 of an unknown place': ('G92 X0', 'line 1: X0: where X is'),
    'G92 of nothing': ('G92', 'line 1: G92: says no axis'),
    'motion without a code': ('X5', 'line 1: X5: no G0'),
    'after G80': ('G0 X0\nG80\nX5', 'line 3: X5: no G0'),
    'two motions': ('G0 G1 X5', 'line 1: G1: contradicts G0'),
    'two planes': ('G17 G18', 'line 1: G18: contradicts'),
    'one word twice': ('G0 X1 X2', 'line 1: X2: X stands twice'),
    'word without meaning': ('G0 X1 Q5', 'line 1: Q5: has no meaning'),
    'dwell without a time': ('G4', 'line 1: G4: says no time'),
    'dwell of a day': ('G4 P86400', 'line 1: G4: 86400 s'),
    'open comment': ('G1 X5 (half', r'line 1: \(half: the comment is not closed'),
    'check sum': ('N1 G0 X1*99', r'line 1: \*99: the check sum of this line is'),
    'CRC': ('N1 G0 X1*00099', r'line 1: \*00099: the check sum'),
    'long line': ('G1 X1' + ' ' * 2000 + 'Y1', 'line 1: .*1000'),
    'binary': ('\x00\x01\x02', r'line 1: \?\?\?: cannot be read'),
    'other letters': ('G1 Х5', r'line 1: \?5: cannot be read'),
    'arc never lit': ('G21\nG0 X1', 'never lit by the codes of dialect waam'),
    'empty': ('', 'never lit'),
}


@pytest.mark.parametrize(('text', 'what'), BAD.values(), ids=BAD.keys())
def test_what_must_fail_is_refused_with_line_and_word(text, what):
    if what is None:  # M30 puts the arc out in our own dialect
        assert len(laid(text)) == 1
        return
    with pytest.raises(ProgramError, match=what):
        read_program(text, OURS)


def test_an_arc_that_burns_at_the_end_is_refused_where_the_end_does_not_put_it_out():
    dialect = dialect_of({'arc_on': 'M3', 'arc_off': 'M5'}, 'here')
    with pytest.raises(ProgramError, match=r'line 4: M30: the arc of line 2 burns'):
        read_program('G0 X0 Y0 Z0\nM3\nG1 X1 F600\nM30', dialect)


@pytest.mark.parametrize(
    ('text', 'what'),
    [
        ('[1, 2]', 'is no mapping'),
        ('a: {b', 'no YAML'),
        ('arc_on: M3', 'arc_on and arc_off: both'),
        ('arc_on: M3\narc_off: hello', "arc_off: 'hello' is no code"),
        ('arc_on: M3\narc_off: M5\nwier: {}', 'wier: unknown; known are'),
        ('wire: {axis: E}\narc_on: M3', 'the arc burns where it feeds'),
        ('wire: {axis: Q}', 'wire.axis'),
        ('wire: {axis: E, diameter: -1}', 'wire.diameter: -1'),
        ('arc_on: M3\narc_off: M5\nwire: {word: W}', 'wire.unit: None'),
        ('arc_on: M3\narc_off: M5\nwire: {word: W, unit: furlong}', "wire.unit: 'furlong'"),
        ('arc_on: M3\narc_off: M5\nwire: {unit: mm/min}', 'give a letter as word, or a value'),
        ('arc_on: M3\narc_off: M5\nwire: 7', 'is no mapping'),
        ('arc_on: M3\narc_off: M5\nidle: jump', "idle: 'jump', must be one of"),
        ("arc_on: M3\narc_off: M5\nlayer: '('", 'no regular expression'),
    ],
)
def test_a_dialect_that_cannot_be_meant_is_refused_with_its_key(text, what):
    with pytest.raises(DialectError, match=what):
        parse_dialect(text, 'mine.yaml')


def test_dialects_are_files_or_names(tmp_path):
    assert shipped() == ('slicer', 'waam', 'welder')
    own = tmp_path / 'own.yaml'
    own.write_text('arc_on: M3\narc_off: M5')
    assert load_dialect(str(own)).wire is None
    with pytest.raises(DialectError, match='no dialect .*slicer'):
        load_dialect(str(tmp_path / 'gone.yaml'))
    with pytest.raises(ProgramError, match='gone.gcode'):
        program_text(tmp_path / 'gone.gcode')


# ---- fuzzing ----

VOCABULARY = '''
G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G28 G53 G54 G80 G90 G91 G90.1 G91.1 G92 G92.1 M2 M3 M5 M7 M30 X1
X-5 Y2 Z3 I4 J5 K6 R7 P1 P2 F600 W6000 S22 E5 N10 % / ( ) ; * #1 [2] M82 M83 T0 *57
'''
WORDS = st.sampled_from(VOCABULARY.split())
VALUES = st.builds(
    '{}{}'.format, st.sampled_from('GMXYZIJKRPFWSENQTO'), st.floats(width=32).map(repr)
)


@given(
    st.lists(st.lists(st.one_of(WORDS, VALUES), max_size=6).map(' '.join), max_size=12).map(
        '\n'.join
    ),
    st.sampled_from([OURS, SLICER, WELDER]),
)
@example('G0 X0 Y0 Z0\nW1 M3\nG2 X10000 R1000000 F1\nM5', OURS)
@settings(max_examples=200, deadline=None)
def test_any_words_are_read_or_refused_with_their_line(text, dialect):
    check(text, dialect)


@given(st.binary(max_size=200), st.sampled_from([OURS, SLICER, WELDER]))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_read_or_refused_with_their_line(data, dialect):
    check(data.decode('utf-8', 'replace'), dialect)


@given(st.data())
@settings(max_examples=20, deadline=None)
def test_a_damaged_program_is_read_or_refused(programs, data):
    text = program_text(programs / 'cura_pad.gcode')
    cut = data.draw(st.integers(0, len(text)))
    at = data.draw(st.integers(0, max(0, cut - 1)))
    damaged = text[:at] + data.draw(st.text(max_size=3)) + text[at + 1 : cut]
    check(damaged, SLICER)


def check(text: str, dialect) -> None:
    try:
        program = read_program(text, dialect)
    except ProgramError as e:
        assert str(e).startswith('line ') or 'never lit' in str(e)
        return
    for m in program.burning:
        corners = m.corners(1e-4)
        assert np.isfinite(corners).all() and np.abs(corners).max() <= 200
        assert m.speed > 0 and (math.isnan(m.wire) or m.wire > 0)


MACROS = 'EXCLUDE_OBJECT_DEFINE NAME=a POLYGON=[[1,2]' + ',[3,4]' * 200 + ']\nSTART_PRINT BED=60\n'


def test_macros_of_a_klipper_printer_are_passed_over():
    text = 'G21 G90 M83\nG1 X0 Y0 Z2 F600\nG1 X9 E5\n'
    assert read(MACROS + text, SLICER) == [replace(m, line=m.line + 2) for m in read(text, SLICER)]


@pytest.mark.parametrize('macro', ['SET_GCODE_OFFSET Z=1', 'START_PRINTER', 'start_print'])
def test_a_macro_that_the_dialect_does_not_name_is_refused(macro):
    with pytest.raises(ProgramError, match=f'line 3: {macro[:5]}'):
        read(f'{MACROS}{macro}\nG1 X1', SLICER)


def test_what_is_no_name_of_a_macro_is_refused_in_a_dialect():
    with pytest.raises(DialectError, match="macros: 'G1' is no name"):
        dialect_of({'wire': {'axis': 'E'}, 'macros': ['G1']}, 'mine')
