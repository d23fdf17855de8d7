"""Shielding gas in Fanuc programs: it flows before the arc is lit, while it burns and after it is out."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from robot_read_fanuc import read_ls

from waam_plan.plan import Plan, PlannedLayer
from waam_plan.robot.cell import FanucSettings, RobotCell
from waam_plan.robot.fanuc import write_ls
from waam_plan.robot.motion import RobotProgramError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

ARC, GAS = 1, 2
EPS = 0.011  # s, programs hold hundredths


def bead(start, end):
    return Segment(
        0, Kind.DEPOSIT, start, end, 0.01, arc=True, height=2e-3, width=6e-3, speed_programmed=0.01
    )


def leg(start, end, speed=0.05):
    return Segment(0, Kind.IDLE, start, end, speed)


def dwell(place, time, arc=False):
    return Segment(0, Kind.DWELL, place, place, 0.01, arc=arc, dwell=time, height=2e-3, width=6e-3)


def beads_with(*between):
    """Two beads of 20 mm with idle moves between them, which begin at A and end at B."""
    return [bead((0.0, 0.0, 0.0), A), *between, bead(B, (0.1, 0.02, 0.0))]


A, B = (0.0, 0.02, 0.0), (0.1, 0.0, 0.0)
HIGH = (0.05, 0.0, 0.1)
PLANS = {
    'bead alone': [bead((0.0, 0.0, 0.0), A)],
    'short way between': beads_with(leg(A, B, speed=0.2)),
    'one long leg': beads_with(leg(A, B, speed=0.01)),
    'two long legs': beads_with(leg(A, HIGH), leg(HIGH, B)),
    'short last leg': beads_with(
        leg(A, HIGH), leg(HIGH, (0.1, 0.0, 0.005)), leg((0.1, 0.0, 0.005), B)
    ),
    'wait between': beads_with(leg(A, B, speed=0.2), dwell(B, 60.0)),
    'crater': [
        bead((0.0, 0.0, 0.0), A),
        dwell(A, 0.3, arc=True),
        leg(A, HIGH),
        leg(HIGH, A),
        bead(A, B),
    ],
    'short way out': [
        leg(HIGH, (0.0, 0.0, 0.0)),
        bead((0.0, 0.0, 0.0), A),
        leg(A, (0.0, 0.02, 0.01)),
    ],
    'short way in': [
        leg((0.0, 0.0, 0.005), (0.0, 0.0, 0.0)),
        bead((0.0, 0.0, 0.0), A),
        leg(A, HIGH),
    ],
}


NUMBERS = FanucSettings(registers=False)
PLAIN = RobotCell(fanuc=NUMBERS)


def plan_of(segments):
    spec = GridSpec(0.0, 0.0, 1e-3, 2, 2)
    flat = np.zeros(spec.shape)
    layer = PlannedLayer(1, flat, flat, flat, segments, (1.0, 0.0, 0.0), flat > 0)
    ground = HeightGrid(spec, flat)
    return Plan(spec, ground, ground, flat > 0, flat > 0, [layer], 0.05, PlanSettings())


def program(files, name='WAAM'):
    """Lines of the main program and of what it calls, in the order of execution, with positions in m."""
    text = files[f'{name}.LS']
    places = {
        n: tuple(float(v) * 1e-3 for v in xyz)
        for n, *xyz in re.findall(
            r'P\[(\d+)\]\{.*?X = *(\S+) .*?Y = *(\S+) .*?Z = *(\S+) ', text, re.S
        )
    }
    for line in re.findall(r'^ *\d+:(.*?) *;?$', text, re.M):
        if line.startswith('CALL '):
            yield from program(files, line[5:])
        else:
            yield line, places


def switches(files):
    """(time s, output, on) in the order of time. The way to the first point takes no time."""
    clock, here, out = 0.0, None, []
    for line, places in program(files):
        if match := re.fullmatch(r'DO\[(\d)\]=(ON|OFF)', line):
            out.append((clock, int(match[1]), match[2] == 'ON'))
        elif match := re.fullmatch(r'WAIT +([\d.]+)\(sec\)', line):
            clock += float(match[1])
        elif match := re.match(r'L P\[(\d+)\] ([\d.]+)mm/sec', line):
            place = places[match[1]]
            took = math.dist(here, place) / (float(match[2]) * 1e-3) if here else 0.0
            here, clock = place, clock + took
            options = re.findall(r'TB ([\d.]+)sec,DO\[(\d)\]=(ON|OFF)', line)
            assert len(options) <= 1, line
            out += [(clock - min(float(b), took), int(n), w == 'ON') for b, n, w in options]
    return sorted(out, key=lambda s: s[0])


def intervals(found, output):
    """(on, off) times of an output."""
    out, since = [], None
    for time, number, on in found:
        if number == output and on and since is None:
            since = time
        elif number == output and not on and since is not None:
            out.append((since, time))
            since = None
    assert since is None, f'DO[{output}] stays on'
    return out


@pytest.mark.parametrize('pre, post', [(0.3, 1.0), (0.0, 0.0), (2.0, 0.05), (0.5, 20.0)])
@pytest.mark.parametrize('name', PLANS)
def test_gas_flows_before_and_after_every_arc(name, pre, post):
    files = write_ls(
        plan_of(PLANS[name]), cell=RobotCell(pre_flow=pre, post_flow=post, fanuc=NUMBERS)
    )
    found = switches(files)
    flows = intervals(found, GAS)
    burns = intervals(found, ARC)
    assert len(burns) == len([1 for s, t in zip([None, *PLANS[name]], PLANS[name], strict=False)
                              if t.arc and not (s and s.arc)])  # fmt: skip
    for lit, out in burns:
        assert any(a <= lit - pre + EPS and out + post - EPS <= b for a, b in flows), (
            lit,
            out,
            flows,
        )


@pytest.mark.parametrize('name', ['two long legs', 'short last leg', 'wait between'])
def test_gas_is_off_during_a_long_way(name):
    found = switches(write_ls(plan_of(PLANS[name]), cell=PLAIN))
    (_, end), (start, _) = intervals(found, GAS)
    (_, out), (lit, _) = intervals(found, ARC)
    assert end == pytest.approx(out + 1.0, abs=EPS) and start == pytest.approx(lit - 0.3, abs=EPS)


def test_waits_are_those_of_the_plan_where_the_way_is_long_enough():
    lines = [line for line, _ in program(write_ls(plan_of(PLANS['wait between']), cell=PLAIN))]
    waits = [float(line[4:-5]) for line in lines if line.startswith('WAIT')]
    # pre-flow of the first, post-flow of the last
    assert sum(waits) == pytest.approx(60.0 + 0.3 + 0.9, abs=EPS)


@pytest.mark.parametrize('name', PLANS)
def test_programs_with_gas_are_read_back(name):
    moves = read_ls(write_ls(plan_of(PLANS[name])))
    assert sum(m.arc for m in moves) == sum(s.kind == Kind.DEPOSIT for s in PLANS[name])


@pytest.mark.parametrize(
    'wrong', [{'pre_flow': -0.1}, {'post_flow': 31.0}, {'lead': math.nan}, {'lead': -0.6}]
)
def test_times_that_the_controller_does_not_take_are_refused(wrong):
    with pytest.raises(RobotProgramError, match=next(iter(wrong))):
        (FanucSettings if 'lead' in wrong else RobotCell)(**wrong)
