"""What `waam job run` says of a job while it runs."""

from __future__ import annotations

import math

from waam_bringup.progress import describe
from waam_msgs.msg import JobStatus


def test_a_pause_says_what_has_held_the_machine_and_what_can_be_done():
    s = JobStatus(state=JobStatus.PAUSED, layer=1, layers=2, height_error_rms=math.nan)
    s.message = 'paused: the wire is slower than commanded; resume or abort'
    assert describe(s) == f'layer 1/2 {s.message}'
    why = 'robot: the torch is 3.1 mm from where it should be'
    assert why in describe(JobStatus(state=JobStatus.PAUSED, message=why))
    s.state, s.bead, s.beads = JobStatus.DEPOSITING, 4, 9
    s.height_error_rms = 2.1e-4
    assert describe(s) == 'layer 1/2 depositing bead 4/9, height error 0.21 mm RMS'
