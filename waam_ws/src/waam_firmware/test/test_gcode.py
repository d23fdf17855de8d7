"""G-code through the controller's own parser: what is understood, and what is refused, by name, line and column."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

BOUNDED = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.fixture
def run(gcode_path):
    """(exit status, moves, error) of a program; a move is (line, kind, mm/s, points)."""

    def run(*lines: str, start: str = "100,100,100", limits: bool = True, every: float = 1e9):
        options = ["--start", start, "--every", str(every)] + ([] if limits else ["--no-limits"])
        result = subprocess.run(
            [gcode_path, *options, "-"],
            input="\n".join(lines).encode("latin-1") + b"\n",
            capture_output=True,
            timeout=30,
        )
        moves = []
        for row in result.stdout.decode().splitlines():
            line, kind, speed, *values = row.split()
            v = [float(x) for x in values]
            points = [tuple(v[i : i + 3]) for i in range(0, len(v), 3)]
            moves.append((int(line), kind, float(speed), points))
        return result.returncode, moves, result.stderr.decode("latin-1").strip()

    return run


def ends(moves) -> list[tuple[float, ...]]:
    return [points[-1] for *_, points in moves]


@pytest.mark.parametrize(
    ('line', 'code', 'column', 'text'),
    [
        # unknown words
        ('T5', 103, 1, 'T is not a word'),
        ('G1 X1 F60 D3', 103, 11, 'D is not a word'),
        ('G33 Z1', 103, 1, 'G33 is not known'),
        ('G90.2', 103, 1, 'G90.2 is not known'),
        ('G0 X1 M4', 103, 7, 'M4 is not known'),
        ('G0 X[1]', 104, 4, 'X needs a number'),
        ('#1=5', 102, 1, 'a letter'),
        ('N5 /G0 X1', 102, 4, 'a letter'),
        ('//G0 X1', 102, 2, 'a letter'),
        ('% G0 X1', 102, 1, '% marks begin or end'),
        ('G0 X1 %', 102, 7, 'a letter'),
        # numbers
        ('G0 X1e-05', 104, 4, 'X: an exponent is not read'),
        ('G0 X1.5 Y2e3', 104, 9, 'Y: an exponent is not read'),
        ('G0 X12345678901', 104, 4, 'X is too large'),
        ('G1 X-.', 104, 4, 'X needs a number'),
        ('G', 104, 1, 'G needs a number'),
        ('G4 P-1', 104, 4, 'P-1 is outside 0..3600 s'),
        ('G4 P5000', 104, 4, 'P5000 is outside 0..3600 s'),
        ('G1 X1 F0', 104, 7, 'F0 is outside 0.001..60000 mm/min'),
        ('G1 X1 F70000', 104, 7, 'F70000 is outside 0.001..60000 mm/min'),
        ('W-1', 104, 1, 'W-1 is outside 0..18000 mm/min'),
        ('S99', 104, 1, 'S99 is outside 0..60 V'),
        ('G1e2', 104, 1, 'G: an exponent is not read'),
        ('G0 X1 (open', 102, 7, 'not closed'),
        ('G1 N5 X1', 102, 4, 'N, the number'),
        # two words of one group, two actions, the same word twice
        ('G1 G2 X1', 105, 4, 'G2 does not go with G1'),
        ('G17 G18', 105, 5, 'G18 does not go with G17'),
        ('G90 X1 G91', 105, 8, 'G91 does not go with G90'),
        ('G20 G21', 105, 5, 'G21'),
        ('G54 G59', 105, 5, 'G59'),
        ('G93 G94', 105, 5, 'G94'),
        ('G90.1 G91.1', 105, 7, 'G91.1'),
        ('M82 M83', 105, 5, 'M83'),
        ('M7 M9', 105, 4, 'M9 does not go with M7'),
        ('M3 S20 W60 M9', 105, 12, 'M9 does not go with M3'),
        ('G0 X1 M5', 105, 4, 'X does not go with this action'),
        ('G0 G80 X1', 105, 4, 'G80 does not go with G0'),
        ('G61 G64', 105, 5, 'G64 does not go with G61'),
        ('G40 G40', 105, 5, 'G40 does not go with G40'),
        ('G64 P0.1 G4', 105, 1, 'two words of this line want P'),
        ('G61 P1', 105, 5, 'P goes with G4'),
        ('G64 P-1', 104, 5, 'P-1 is outside 0..100000 mm'),
        ('G64 Q-1', 104, 5, 'Q-1 is outside 0..100000 mm'),
        ('G1 X1 F60 Q3', 105, 11, 'Q goes with G64'),
        ('G61.1', 103, 1, 'G61.1 is not known'),
        ('G41', 103, 1, 'G41 is not known'),
        ('G43', 103, 1, 'G43 is not known'),
        ('M3 S20 W60 G4 P1', 105, 12, 'G4 does not go with M3'),
        ('G0 X1 Y2 X3', 105, 10, 'X is given twice'),
        # words that want the same thing, or nothing
        ('G1 G92 X1 F60', 105, 1, 'want the coordinates'),
        ('G4 P1 X1', 105, 7, 'X does not go'),
        ('G28 Z5', 105, 5, 'Z does not go'),
        ('G1 X1 P5 F60', 105, 7, 'P goes with G4'),
        ('G1 X1 L2 F60', 105, 7, 'L goes with G10'),
        ('G53', 105, 1, 'G53 goes with a move'),
        ('G91 G53 G0 X1', 105, 5, 'G53 needs G90'),
        ('G53 G2 I5 F60', 105, 1, 'G53 goes with G0 and G1'),
        # missing words
        ('X1', 107, 1, 'G0, G1, G2 or G3'),
        ('G80 X1', 107, 5, 'G0, G1, G2 or G3'),
        ('G1 X1', 107, 4, 'feed F'),
        ('G93 G1 X1', 107, 8, 'every move needs its F'),
        ('G4', 107, 1, 'P, seconds'),
        ('G92', 107, 1, 'X, Y, Z or E'),
        ('G10 L2 X1', 107, 1, 'P1..P6'),
        ('G10 L3 P1 X1', 104, 5, 'L2'),
        ('G10 L2 P7 X1', 104, 8, 'P1..P6'),
        ('G10 L2 P1.5 X1', 104, 8, 'P1..P6'),
        ('M3 S20', 107, 1, 'wire'),
        ('M3 W60', 107, 1, 'voltage'),
        # arcs
        ('G2 X110 F60', 107, 1, 'R, or its centre'),
        ('G2 X110 K5 F60', 105, 9, 'K is not in the plane'),
        ('G18 G3 X110 J5 F60', 105, 13, 'J is not in the plane'),
        ('G2 X110 R5 I5 F60', 105, 12, 'I contradicts R'),
        ('G2 Z110 R5 F60', 107, 9, 'end in the plane'),
        ('G2 X100 Y100 R5 F60', 105, 14, 'full circle'),
        ('G2 X110 R4.9 F60', 105, 9, 'R 4.9 mm cannot reach an end that is 10 mm away'),
        ('G2 X110 I4 F60', 105, 9, 'the start is 4 mm from the centre and the end 6 mm'),
        ('G2 X110 I0 F60', 105, 9, 'no radius'),
        ('G90.1 G2 X110 I105 F60', 107, 7, 'both coordinates'),
        ('G1 X110 I5 F60', 105, 9, 'I goes with G2 and G3'),
        # the machine's room: also on the way
        ('G1 Y-0.01 F60', 302, 4, 'Y -0.01 mm (machine) is outside 0..300'),
        ('G2 X100 Y100 I-60 F60', 302, 4, 'the arc reaches X -20 mm (machine) is outside 0..400'),
        ('G3 Y200 J50 R0 F60', 105, 9, 'J contradicts R'),
        ('G19 G2 Y180 Z100 R-60 F60', 302, 13, 'the arc reaches Z'),
        # wire
        ('G1 X101 E5 F60', 107, 9, 'E needs M82'),
        ('M83 W60', 105, 1, 'send W0 first'),
        ('M83 G1 X101 E5 F60', 105, 13, 'the arc is on'),
        ('M83 G0 E5 F60', 105, 8, 'E does not go with G0'),
        ('W18001', 104, 1, 'W18001 is outside 0..18000'),
    ],
)  # fmt: skip
def test_refusal_names_code_line_and_column(run, line, code, column, text):
    status, moves, error = run("(first line)", line, "G0 X1")
    assert status == 1 and moves == []
    where, _, what = error.partition(": ")
    assert where == f"-:2:{column}" and what.startswith(f"E{code} ") and text in what


def test_words_may_be_packed_lower_case_and_commented(run):
    status, moves, error = run("%", "n10g1f600x101.5(a)y 99;b", "", "  ( c ) z+100.5 ", "%")
    assert (status, error) == (0, "")
    assert ends(moves) == [(101.5, 99.0, 100.0), (101.5, 99.0, 100.5)]
    assert {speed for _, _, speed, _ in moves} == {10.0}


def test_planes_and_senses(run):
    """A quarter to the right of the start: clockwise seen from the positive end of the axis across the plane."""
    for plane, centre, axes in (
        (17, "I10", (0, 1)),
        (18, "K10", (2, 0)),
        (19, "J10", (1, 2)),
    ):
        for motion, side in (("G2", 1.0), ("G3", -1.0)):
            _, moves, error = run(f"G{plane} {motion} {centre} F60", every=1.0)
            assert not error
            points = moves[0][3]
            quarter = points[round((len(points) - 1) / 4)]
            first, second = (quarter[a] - 100 for a in axes)
            assert first == pytest.approx(10, abs=0.7)
            assert second == pytest.approx(side * 10, abs=0.1)
            assert math.dist(points[0], points[-1]) == pytest.approx(0.0, abs=1e-6)


def test_radius_sign_chooses_the_arc(run):
    lengths = []
    for words in ("G2 X110 R6", "G2 X110 R-6", "G3 X110 R6", "G3 X110 R-6"):
        _, moves, _ = run(words + " F60", every=0.01)
        points = moves[0][3]
        lengths.append(sum(math.dist(a, b) for a, b in zip(points, points[1:], strict=False)))
    half = 2 * 6 * math.asin(5 / 6)
    expected = [half, 2 * math.pi * 6 - half] * 2
    assert lengths == pytest.approx(expected, rel=1e-5)


def test_half_a_turn_by_radius_may_be_a_rounding_short(run):
    _, moves, error = run("G2 X110.0006 R5 F60")
    assert not error and ends(moves) == [(110.0006, 100.0, 100.0)]


def test_frames(run):
    """G54..G59, G10 L2 and L20, G92, G53 for one block, G91 between them."""
    _, moves, error = run(
        "G0 X1 Y1 Z1",
        "G10 L2 P2 X10 Y20",
        "G0 X1",
        "G55 X1",
        "G53 X1",
        "X2",
        "G92 X0",
        "X1",
        "G54 X1",
        "G92.1",
        "X1",
        "G91 X0.5 Y2",
        "G90 G10 L20 P0 X100",
        "X101",
        "G59 X7",
        "M2",
        "G1 X103 F60",
    )
    assert not error
    assert [x for x, _, _ in ends(moves)] == [1, 11, 1, 12, 13, 3, 1, 1.5, 2.5, 7, 4.5]


def test_units_and_inverse_time(run):
    _, moves, error = run(
        "G20", "G1 X4 F10", "G21 X100", "G93 G1 X110 F3", "G3 X90 R10 F6", "G94 G1 F60 X91"
    )
    assert not error
    assert ends(moves)[0][0] == pytest.approx(101.6)
    speeds = [speed for _, _, speed, _ in moves]
    tenth = 10 * 25.4 / 60
    assert speeds == pytest.approx([tenth, tenth, 0.5, math.pi * 10 * 6 / 60, 1.0], rel=1e-6)
    status, _, error = run("G93 G1 X110 F3", "G94 X120")
    assert status == 1 and error == "-:2:5: E107 a move needs a feed F"


def test_tiny_steps_are_not_lost(run):
    """A thousand relative moves below a step each add up."""
    _, moves, _ = run("G91 G1 F60", *["X0.001"] * 1000, *["Y0.0002"] * 1000)
    assert ends(moves)[-1] == pytest.approx((101.0, 100.2, 100.0), abs=6e-4)
    chained = [math.dist(a[3][-1], b[3][0]) for a, b in zip(moves, moves[1:], strict=False)]
    assert max(chained) < 5e-4


def test_end_of_program_restores_modes(run):
    _, moves, error = run("G91 G18 G55 G1 F60 X1", "M2", "X50", "G2 I5")
    assert not error and ends(moves)[1][0] == 50.0 and len(moves) == 3


def test_what_cam_programs_begin_with(run):
    """Compensation off, no canned cycle, path control: said in every preamble, and always so here."""
    _, moves, error = run(
        '%',
        '(BRACKET)',
        'G90 G94 G17 G91.1 G21 G40 G49 G80 G64 P0.01 Q0.02',
        'G61',
        'G53 G0 Z120',
        'M8',
        'G0 X101 M7',
        'G1 Y102 F600 M9',
        '/G1 X103',
        '/ N70 M9',
        'G64',
        'G80 M9',
        'G2 X104 R5 M8',
        'M9 M30',
        '%',
    )
    assert not error
    assert [end[:2] for end in ends(moves)] == [
        (100, 100), (101, 100), (101, 102), (103, 102), (104, 102)
    ]  # fmt: skip
    assert [kind for _, kind, _, _ in moves] == ['rapid', 'rapid', 'line', 'line', 'arc']


def test_numbers_may_have_any_length(run):
    """As Python prints a float, or a post-processor that has been told to be exact."""
    long = f'{100.1:.60f}'
    _, moves, error = run(f'G0 X{long} Y{"0" * 40}101', f'G0 X{100.3!r}{"0" * 30} Y.{"0" * 50}')
    assert not error
    assert ends(moves) == [(100.1, 101.0, 100.0), (100.3, 0.0, 100.0)]


def test_a_small_e_in_a_program_in_small_letters_is_a_word(run):
    status, _, error = run('g0 x1e5')
    assert status == 1 and 'E needs M82' in error


WORDS = st.lists(
    st.one_of(
        st.builds(
            "{}{}".format,
            st.sampled_from("GMXYZIJKREFPLWSNTQgx"),
            st.one_of(
                st.integers(-100, 100),
                st.floats(-1e10, 1e10).map(lambda x: f"{x:.5f}"),
                st.sampled_from(["", ".", "-", "+.", "1e3", "0.0000001", "99999999999999999999"]),
            ),
        ),
        st.sampled_from(
            [
                "G2",
                "G3",
                "G1",
                "F60",
                "M83",
                "W0",
                "G10 L2",
                "(",
                ")",
                ";",
                "%",
                "\xff",
                "\t",
            ]
        ),
    ),
    max_size=9,
).map(" ".join)


def test_any_line_is_taken_or_refused(run):
    """Never a crash; what is refused names a column inside the line; what is taken stays inside the machine."""

    @BOUNDED
    @given(st.lists(WORDS, max_size=6))
    def words(lines: list[str]) -> None:
        status, moves, error = run("G1 F600", *lines)
        if status == 1:
            _, line, column, text = error.split(":", 3)
            assert (
                1 <= int(column) <= max(1, len(lines[int(line) - 2]))
                and 102 <= int(text[2:5]) <= 305
            )
        else:
            assert (status, error) == (0, "")
        for _, kind, speed, points in moves:
            assert kind == "wire" or all(
                -0.002 <= v <= most + 0.002
                for p in points
                for v, most in zip(p, (400, 300, 200), strict=True)
            )
            assert 0 < speed <= 1000

    words()


PROGRAMS = Path(__file__).parent / 'programs'


@pytest.mark.parametrize('path', sorted(PROGRAMS.glob('cam_*.nc')), ids=lambda p: p.stem)
def test_programs_in_the_manner_of_cam_systems_are_taken(run, path):
    """test_judge.py compares their paths with those of rs274, where that is installed."""
    status, moves, error = run(*path.read_text().splitlines(), start='0,0,0', limits=False)
    assert (status, error) == (0, '') and len(moves) >= 5


@pytest.mark.parametrize(
    ('name', 'line', 'column', 'text', 'moves'),
    [
        ('slicer_prusa', 13, 1, 'M104 is not known', 2),
        ('slicer_cura', 12, 1, 'M107 is not known', 2),
        ('slicer_slic3r', 8, 1, 'T is not a word', 2),
    ],
)
def test_slicers_are_understood_up_to_their_heaters_and_tools(
    gcode_path, name, line, column, text, moves
):
    """Units, distances, E and its zero are read; a word of another machine is named, never passed over."""
    path = PROGRAMS / f'{name}.gcode'
    result = subprocess.run([gcode_path, str(path)], capture_output=True, text=True, timeout=30)
    assert result.returncode == 1 and len(result.stdout.splitlines()) == moves
    assert result.stderr.startswith(f'{path}:{line}:{column}: E103 ') and text in result.stderr
