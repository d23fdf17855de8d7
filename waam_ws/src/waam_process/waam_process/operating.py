"""What every way to run a job agrees on: command line, page, laboratory, bridge."""

from __future__ import annotations

DEFAULT_MATERIAL = 'er70s-6'  # key of the material table, where a job names none
GANTRY, ROBOT = MACHINES = ('gantry', 'robot')  # what may move the torch

# range of an operator's factor on the programmed value (Override.msg; the controller checks it again)
SPEED_FACTOR = (0.1, 2.0)  # travel speed
WIRE_FACTOR = (0.5, 1.5)  # wire feed
# range of each factor by which a process control may multiply the operator's
PROCESS_FACTOR = (0.5, 1.5)

# m, x, y, z: the plate on the simulated table for a build (job_sequencer: plate_zero)
BUILD_PLATE = (0.240, 0.200, 0.010)
