"""The reader against LinuxCNC's rs274: the chords that a job lays are its path within a micrometre."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rs274 import available, exact_off_um, off_um, random_program  # noqa: E402


@pytest.mark.skipif(
    not available(), reason="LinuxCNC's rs274 (package linuxcnc-uspace) is not installed"
)
def test_path_equals_that_of_linuxcnc(programs):
    rng = random.Random(7)
    for file in programs.glob('*.gcode'):
        off, moves = off_um(file.read_text(), 'slicer')
        assert off < 1.0 and moves > 50, file.name
    for _ in range(8):
        text = random_program(rng)
        assert off_um(text, 'waam')[0] < 1.0, text


def test_chords_of_random_programs_lie_on_their_circles():
    rng = random.Random(8)
    for _ in range(10):
        off, arcs = exact_off_um(random_program(rng), 'waam')
        assert off < 0.51 and arcs >= 2
