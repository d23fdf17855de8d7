"""What every way to run a job agrees on: command line, page, laboratory, bridge."""

from __future__ import annotations

from collections.abc import Sequence

DEFAULT_MATERIAL = 'er70s-6'  # key of the material table, where a job names none
PRESETS = {  # how rough the simulated cell is (waam_sim/config/presets), in words for people
    'gentle': 'gentler than metal',
    'recorded': 'beads, arc and scans scatter as in recordings of real cells',
    'rough': 'the upper end of the recordings, with warp and spatter',
}
DEFAULT_PRESET = 'recorded'  # the one place that says which, where none is named
GANTRY, ROBOT = MACHINES = ('gantry', 'robot')  # what may move the torch

# steps for a turn of the chuck of a simulated cell, where nobody says how many
CHUCK_STEPS = 32000.0

# range of an operator's factor on the programmed value (Override.msg; the controller checks it again)
SPEED_FACTOR = (0.1, 2.0)  # travel speed
WIRE_FACTOR = (0.5, 1.5)  # wire feed
# range of each factor by which a process control may multiply the operator's
PROCESS_FACTOR = (0.5, 1.5)

# m, x, y, z: the plate on the simulated table for a build, and work zero seen from its corner (job_sequencer)
BUILD_PLATE = (0.240, 0.200, 0.010)
PLATE_ZERO = (0.020, 0.020, 0.010)


def check_preset(name: str) -> str:
    """`name` itself; ValueError names the presets that there are."""
    if name not in PRESETS:
        raise ValueError(f"preset '{name}' of the simulated cell: known are {', '.join(PRESETS)}")
    return name


def build_plate(
    upper: Sequence[float], zero: Sequence[float] = PLATE_ZERO
) -> tuple[float, float, float]:
    """m: the simulated plate for a build that reaches up to `upper` (x, y; m from work zero).

    `BUILD_PLATE`, or as much larger as leaves the rim before work zero (`zero`) behind the build as well.
    """
    x, y = (max(BUILD_PLATE[k], upper[k] + 2 * zero[k]) for k in range(2))
    return x, y, BUILD_PLATE[2]
