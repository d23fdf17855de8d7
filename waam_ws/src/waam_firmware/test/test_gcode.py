"""G-code through the controller's own parser: what is understood, and what is refused, by name, line and column."""

from __future__ import annotations

import math
import subprocess

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
        # unknown words: of other machines, and of this one once
        ('T5', 103, 1, 'T is not a word'),
        ('G1 X1 F60 D3', 103, 11, 'D is not a word'),
        ('G1 X101 E5 F60', 103, 9, 'E is not a word'),
        ('G2 X110 R5 F60', 103, 9, 'R is not a word'),
        ('G33 Z1', 103, 1, 'G33 is not known'),
        ('G90.1', 103, 1, 'G90.1 is not known'),
        ('G0 X1 M4', 103, 7, 'M4 is not known'),
        *[(f'G1 {code} X1', 103, 4, f'{code} is not known') for code in (
            'G18', 'G20', 'G40', 'G53', 'G55', 'G80', 'G92', 'G93', 'M0', 'M8', 'M83',
        )],
        ('N5 G0 X1', 103, 1, 'N is not a word'),
        ('G0 X[1]', 104, 4, 'X needs a number'),
        ('#1=5', 102, 1, 'a letter'),
        ('/G0 X1', 102, 1, 'a letter'),
        ('%', 102, 1, 'a letter'),
        ('G0 X1 (open', 102, 7, 'a letter'),
        # numbers
        ('G0 X1e-05', 103, 6, 'E is not a word'),
        ('G0 X12345678901', 104, 4, 'X is too large'),
        ('G1 X-.', 104, 4, 'X needs a number'),
        ('G', 104, 1, 'G needs a number'),
        ('G4 P-1', 104, 4, 'P-1 is outside 0..3600 s'),
        ('G4 P5000', 104, 4, 'P5000 is outside 0..3600 s'),
        ('G1 X1 F0', 104, 7, 'F0 is outside 0.001..60000 mm/min'),
        ('G1 X1 F70000', 104, 7, 'F70000 is outside 0.001..60000 mm/min'),
        ('W-1', 104, 1, 'W-1 is outside 0..18000 mm/min'),
        ('W18001', 104, 1, 'W18001 is outside 0..18000'),
        ('S99', 104, 1, 'S99 is outside 0..60 V'),
        # two words of one group, two actions, the same word twice
        ('G1 G2 X1', 105, 4, 'G2 does not go with G1'),
        ('G17 G17', 105, 5, 'G17 does not go with G17'),
        ('G90 X1 G91', 105, 8, 'G91 does not go with G90'),
        ('M7 M9', 105, 4, 'M9 does not go with M7'),
        ('M3 S20 W60 M9', 105, 12, 'M9 does not go with M3'),
        ('G0 X1 M5', 105, 4, 'X does not go with this action'),
        ('M3 S20 W60 G4 P1', 105, 12, 'G4 does not go with M3'),
        ('G0 X1 Y2 X3', 105, 10, 'X is given twice'),
        # words that go with another action
        ('G4 P1 X1', 105, 7, 'X does not go'),
        ('G28 Z5', 105, 5, 'Z does not go'),
        ('G1 X1 P5 F60', 105, 7, 'P goes with G4'),
        # missing words
        ('X1', 107, 1, 'G0, G1, G2 or G3'),
        ('G1 X1', 107, 4, 'feed F'),
        ('G4', 107, 1, 'P, seconds'),
        ('M3 S20', 107, 1, 'wire'),
        ('M3 W60', 107, 1, 'voltage'),
        # arcs
        ('G2 X110 F60', 107, 1, 'its centre'),
        ('G2 X110 I4 F60', 105, 9, 'the start is 4 mm from the centre and the end 6 mm'),
        ('G2 X110 I0 F60', 105, 9, 'no radius'),
        ('G1 X110 I5 F60', 105, 9, 'I goes with G2 and G3'),
        # the machine's room: also on the way
        ('G1 Y-0.01 F60', 302, 4, 'Y -0.01 mm (machine) is outside 0..300'),
        ('G2 X100 Y100 I-60 F60', 302, 4, 'the arc reaches X -20 mm (machine) is outside 0..400'),
    ],
)  # fmt: skip
def test_refusal_names_code_line_and_column(run, line, code, column, text):
    status, moves, error = run("; first line", line, "G0 X1")
    assert status == 1 and moves == []
    where, _, what = error.partition(": ")
    assert where == f"-:2:{column}" and what.startswith(f"E{code} ") and text in what


def test_words_may_be_packed_lower_case_and_commented(run):
    status, moves, error = run("g1f600x101.5y 99;b", "", "  z+100.5 ; (c)")
    assert (status, error) == (0, "")
    assert ends(moves) == [(101.5, 99.0, 100.0), (101.5, 99.0, 100.5)]
    assert {speed for _, _, speed, _ in moves} == {10.0}


def test_senses_of_arcs(run):
    """A quarter to the right of the start: clockwise seen from above."""
    for motion, side in (("G2", 1.0), ("G3", -1.0)):
        _, moves, error = run(f"G17 {motion} I10 F60", every=1.0)
        assert not error
        points = moves[0][3]
        quarter = points[round((len(points) - 1) / 4)]
        assert quarter == pytest.approx((110, 100 + side * 10, 100), abs=0.7)
        assert math.dist(points[0], points[-1]) == pytest.approx(0.0, abs=1e-6)


def test_tiny_steps_are_not_lost(run):
    """A thousand relative moves below a step each add up."""
    _, moves, _ = run("G91 G1 F60", *["X0.001"] * 1000, *["Y0.0002"] * 1000)
    assert ends(moves)[-1] == pytest.approx((101.0, 100.2, 100.0), abs=6e-4)
    chained = [math.dist(a[3][-1], b[3][0]) for a, b in zip(moves, moves[1:], strict=False)]
    assert max(chained) < 5e-4


def test_numbers_may_have_any_length(run):
    """As Python prints a float, or a post-processor that has been told to be exact."""
    long = f'{100.1:.60f}'
    _, moves, error = run(f'G0 X{long} Y{"0" * 40}101', f'G0 X{100.3!r}{"0" * 30} Y.{"0" * 50}')
    assert not error
    assert ends(moves) == [(100.1, 101.0, 100.0), (100.3, 0.0, 100.0)]


WORDS = st.lists(
    st.one_of(
        st.builds(
            "{}{}".format,
            st.sampled_from("GMXYZIJEFPWSTgx"),
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
        for _, _, speed, points in moves:
            assert all(
                -0.002 <= v <= most + 0.002
                for p in points
                for v, most in zip(p, (400, 300, 200), strict=True)
            )
            assert 0 < speed <= 1000

    words()
