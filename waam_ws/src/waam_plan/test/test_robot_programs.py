"""Programs for Fanuc, KUKA and ABB robots are read back to the plan, and the simulated robot goes its path."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_read_abb import read_rapid
from robot_read_fanuc import read_ls
from robot_read_kuka import read_krl
from robot_run import check, path_of, run

from waam_plan.layers.restore import plan_restoration
from waam_plan.plan import Plan, PlannedLayer
from waam_plan.robot import parts
from waam_plan.robot.abb import write_rapid
from waam_plan.robot.cell import FanucSettings, RobotCell, cell_of
from waam_plan.robot.fanuc import write_ls
from waam_plan.robot.kuka import write_krl
from waam_plan.robot.motion import RobotProgramError, course
from waam_plan.robot.poses import WIDEST_TURN, steps
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment
from waam_robot.frames import pose_from_wpr

LANGUAGES = {
    'fanuc': (write_ls, read_ls),
    'kuka': (write_krl, read_krl),
    'abb': (write_rapid, read_rapid),
}
ROUNDED = 0.09e-6  # m, positions have four decimals of a mm
CENTRE = (-0.03, -0.03, 0.0)  # the turn axis goes through (30, 30) mm of the plan
SETTINGS = PlanSettings()


def plan_of(*layers):
    spec = GridSpec(0.0, 0.0, 1e-3, 2, 2)
    flat = np.zeros(spec.shape)
    ground = HeightGrid(spec, flat)
    planned = [
        PlannedLayer(n, flat, flat, flat, segments, (1.0, 0.0, 0.0), flat > 0)
        for n, segments in enumerate(layers, 1)
    ]
    return Plan(spec, ground, ground, flat > 0, flat > 0, planned, 0.05, SETTINGS)


def layer(*beads, number=1, z=0.0, speed=0.01, height=2e-3):
    """Beads along polylines (m, in the plane), each reached from above."""
    up = z + 0.02
    here = (0.0, 0.0, up)
    out = []
    for n, corners in enumerate(beads, 1):
        places = [(float(x), float(y), z) for x, y in corners]
        above = (*places[0][:2], up)
        out += [idle(here, above), idle(above, places[0])]
        for a, b in zip(places, places[1:], strict=False):
            metal = dict(height=height, width=6e-3, layer=number, bead=n, arc=True)
            out.append(Segment(0, Kind.DEPOSIT, a, b, speed, speed_programmed=speed, **metal))
        here = (*places[-1][:2], up)
        out.append(idle(places[-1], here))
    return [s for s in out if s.length > 0]


def idle(a, b):
    return Segment(0, Kind.IDLE, a, b, 0.05, speed_programmed=0.05)


def ring(radius, share=0.95, n=90):
    t = np.linspace(0.0, 2 * np.pi * share, n)
    return np.column_stack([0.03 + radius * np.cos(t), 0.03 + radius * np.sin(t)])


SQUARE = [(0.01, 0.01), (0.05, 0.01), (0.05, 0.05), (0.01, 0.05), (0.012, 0.012)]


@pytest.fixture(scope='module')
def small():
    """Two equal layers and one that differs: rings, a square with a sharp corner, a line."""
    beads = (ring(0.02), SQUARE, [(0.02, 0.03), (0.04, 0.03)])
    return plan_of(
        layer(*beads), layer(*beads, number=2, z=0.002), layer(ring(0.015), number=3, z=0.004)
    )


@pytest.mark.parametrize('positioner', ['none', 'hold', 'turn', 'place'])
@pytest.mark.parametrize('language', LANGUAGES)
def test_the_robot_goes_the_path_of_the_plan(language, positioner, small):
    write, read = LANGUAGES[language]
    turning = (20.0, 1.5, -0.8) if positioner == 'place' else (0.0, 0.0, 0.0)
    exact = RobotCell(positioner=positioner, turning=turning, origin=CENTRE)
    moves = read(write(small, cell=exact), cell=exact)
    found = check(small, moves, exact)
    assert found.path < 10e-6 and found.lean < 1e-4
    if positioner == 'place':
        assert all(
            m.external == pytest.approx((0.0, exact.turn_at(m.end)), abs=1e-4) for m in moves
        )
        assert np.ptp([m.external[1] for m in moves if m.arc]) > 0.5
    if positioner != 'none':
        return
    rough = replace(exact, corner=0.1e-3)
    moves = read(write(small, cell=rough, tolerance=20e-6), cell=rough)
    assert any(m.via for m in moves) and len(moves) < 60  # rings are arcs
    found = check(small, moves, rough)
    assert (
        20e-6 < found.path < 0.12e-3 + 1e-6
    )  # of the square: corners are rounded off, and by no more


def test_all_languages_ask_for_the_same(small):
    cell = RobotCell(positioner='turn', origin=CENTRE)
    first, *others = (
        read(write(small, cell=cell), cell=cell) for write, read in LANGUAGES.values()
    )
    for other in others:
        for a, b in zip(first, other, strict=True):
            assert math.dist(a.end, b.end) < 2 * ROUNDED and a.arc == b.arc
            assert (a.via is None) == (b.via is None)
            assert a.external == pytest.approx(b.external, abs=1e-5)
            turns = pose_from_wpr(np.zeros((2, 3)), np.array([a.wpr, b.wpr]))
            assert np.abs(turns[0] - turns[1]).max() < 2e-5
            assert (a.speed, a.feed, a.voltage) == pytest.approx((b.speed, b.feed, b.voltage), 2e-3)


@given(
    st.lists(
        st.lists(
            st.tuples(st.floats(-0.1, 0.3), st.floats(-0.1, 0.3)),
            min_size=2, max_size=6, unique_by=lambda p: (round(p[0], 3), round(p[1], 3)),
        ), min_size=1, max_size=3,
    ),
    st.floats(3e-3, 18e-3), st.floats(0.5e-3, 3e-3), st.sampled_from(sorted(LANGUAGES)),
    st.sampled_from(['none', 'hold', 'turn']), st.booleans(),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_any_plan_is_read_back(beads, speed, height, language, positioner, registers):
    write, read = LANGUAGES[language]
    cell = RobotCell(positioner=positioner, fanuc=FanucSettings(registers=registers))
    segments = layer(*beads, speed=speed, height=height)
    moves = read(write(plan_of(segments), cell=cell, tolerance=1e-9), cell=cell)
    assert all(len(m.external) == (0 if positioner == 'none' else 2) for m in moves)
    laid = [(a.end, b) for a, b in zip(moves, moves[1:], strict=False) if b.arc]
    for s in (s for s in segments if s.arc):
        assert min(off(s.end, a, b.end) for a, b in laid) < ROUNDED
    assert sum(math.dist(a, b.end) for a, b in laid) == pytest.approx(
        sum(s.length for s in segments if s.arc), abs=1e-6
    )
    feed = 0.73 * 6e-3 * height * speed / (SETTINGS.wire_area * SETTINGS.efficiency)
    assert all(m.feed == pytest.approx(feed, rel=2e-3, abs=2e-5) for _, m in laid)
    assert all(m.speed == pytest.approx(speed, rel=2e-3, abs=5e-6) for _, m in laid)
    starts = sum(b.arc and not a.arc for a, b in zip(moves, moves[1:], strict=False))
    assert starts == len(beads)


def off(point, a, b):
    """m: distance of a point from a line between two others."""
    p, a, b = map(np.array, (point, a, b))
    t = np.clip((p - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
    return float(np.linalg.norm(a + t * (b - a) - p))


# ---- positioner --------------------------------------------------------------------------------


def test_the_positioner_carries_a_ring_to_a_torch_that_stands_still():
    plan = plan_of(layer(ring(0.02)))
    cell = RobotCell(positioner='turn', origin=CENTRE)
    path = path_of(read_ls(write_ls(plan, cell=cell), cell=cell), cell)
    shifted = path.poses.copy()
    shifted[:, :3, 3] += cell.origin
    held = cell.device.to_robot(shifted, path.external[:, 0], path.external[:, 1])[path.arc]
    assert np.ptp(held[:, :3, 3], axis=0).max() < 1e-4
    assert np.abs(held[:, :3, :3] - held[0, :3, :3]).max() < 1e-4  # it does not spin
    still = replace(cell, positioner='hold')
    path = path_of(read_ls(write_ls(plan, cell=still), cell=still), still)
    assert np.ptp(path.external, axis=0).max() == 0


def test_the_positioner_comes_home_in_steps(small):
    cell = RobotCell(positioner='turn', origin=CENTRE)
    moves = read_krl(write_krl(small, cell=cell), cell=cell)
    c = np.array([m.external[1] for m in moves])
    assert np.abs(np.diff(c)).max() < WIDEST_TURN + 1e-6
    assert c[0] == pytest.approx(-math.pi / 2, abs=1e-6) == c[-1]
    assert np.ptp(c) > math.radians(330)
    joints = run(path_of(moves, cell), cell).joints
    assert np.abs(np.diff(joints, axis=0)).max() < math.radians(80)


def test_a_leaning_torch_is_brought_upright():
    lean = (math.sin(0.3), 0.0, math.cos(0.3))
    segments = [s.at(tool_axis=lean) for s in layer([(0.05, 0.03), (0.05, 0.032)])]
    cell = RobotCell(positioner='turn', origin=CENTRE)
    plan = plan_of(segments)
    moves = read_rapid(write_rapid(plan, cell=cell), cell=cell)
    laid = next(m for m in moves if m.arc)
    assert abs(laid.external[0]) == pytest.approx(0.3, abs=0.01)
    found = check(plan, moves, cell)
    assert found.lean < 1e-4
    path = path_of(moves, cell)
    held = cell.device.to_robot(path.poses, path.external[:, 0], path.external[:, 1])
    assert held[path.arc][:, 2, 2] == pytest.approx(-1.0, abs=1e-3)


def test_a_positioner_with_a_short_range_is_named():
    cell = RobotCell(positioner='turn', origin=CENTRE, turn_low_deg=-200, turn_high_deg=100)
    with pytest.raises(RobotProgramError, match=r'layer 1 at \(.*\) mm: the positioner would turn'):
        write_ls(plan_of(layer(ring(0.02))), cell=cell)


def test_a_place_out_of_reach_is_named(small):
    cell = RobotCell(positioner='hold', origin=(3.0, 0.0, 0.0))
    with pytest.raises(RobotProgramError, match=r'does not get beyond \(.*\) mm .* out of reach'):
        check(small, read_ls(write_ls(small, cell=cell), cell=cell), cell)


def test_another_path_is_told(small):
    cell = RobotCell(origin=CENTRE)
    files = write_krl(small, cell=cell)
    moves = read_krl(files, cell=cell)
    bent = [replace(m, end=(m.end[0], m.end[1] + 1e-3, m.end[2])) if m.arc else m for m in moves]
    assert check(small, bent, cell).path > 0.5e-3
    dark = [replace(m, arc=False) for m in moves]
    with pytest.raises(RobotProgramError, match='lights the arc 0 times, the plan 7 times'):
        check(small, dark, cell)
    leaning = [replace(m, wpr=(math.pi - 0.1, 0.0, 0.0)) for m in moves]
    assert check(small, leaning, cell).lean == pytest.approx(0.1, abs=1e-6)


# ---- the languages -----------------------------------------------------------------------------


def lines(text):
    return re.findall(r'^ *\d+:(.*?) *;?$', text, re.M)


def test_fanuc_has_its_parameters_in_registers(small):
    cell = RobotCell(positioner='turn', origin=CENTRE, fanuc=FanucSettings(lead=0.2))
    files = write_ls(small, cell=cell)
    main, first = lines(files['WAAM.LS']), lines(files['WAAM001.LS'])
    for text in ('R[32]=0.20', 'R[71]=1', 'R[92]=1', 'R[101]=50.00'):
        assert text in main
    assert any('R[101]mm/sec' in line for line in first)
    waits = any(line == 'WAIT R[50]' for line in first)  # where the idle moves are too short
    assert ('R[50]=0.30' in main) == waits
    roles = [line for line in first if line.startswith('R[10]=')]
    assert [line[6:11] for line in roles] == ['R[71]', 'R[72]', 'R[73]']  # first, inner, last bead
    assert [line[6:11] for line in first if line.startswith('R[11]=')] == [
        'R[91]',
        'R[92]',
        'R[93]',
    ]
    assert all('COORD' in line for line in first if line.startswith('L '))
    assert any(line.endswith('TB R[32]sec,DO[1]=OFF') for line in first)
    assert files['WAAM001.LS'].count('GP2:') == files['WAAM001.LS'].count('GP1:')
    assert '1,1,*,*,*' in files['WAAM001.LS']
    moves = read_ls(files, cell=cell)
    files['WAAM.LS'] = files['WAAM.LS'].replace('R[72]=1 ', 'R[72]=1.25 ')
    changed = read_ls(files, cell=cell)
    ratios = [b.feed / a.feed for a, b in zip(moves, changed, strict=True) if a.arc]
    assert sorted({round(r, 3) for r in ratios}) == [1.0, 1.25]


# ---- what is declared is used, and what is used is declared


def named(pattern: str, text: str) -> set[str]:
    return set(re.findall(pattern, text))


def names_of_fanuc(files: dict[str, str]) -> tuple[set[str], set[str]]:
    """Registers and points that are set, and those that are read. PR and P count as a whole."""
    declared, used = set(), set()
    for file, text in files.items():
        program, places = text.split('/POS')
        for line in lines(program):
            assigned = re.match(r'(P?R\[\d+)(?:,\d)?\]=', line)
            declared |= {assigned[1]} if assigned else set()
            used |= named(r'P?R\[\d+', line[assigned.end() :] if assigned else line)
            used |= {f'{file} {p}' for p in named(r'(?<![A-Z])P\[\d+', line)}
        declared |= {f'{file} {p}' for p in named(r'(?m)^P\[\d+', places)}
        declared |= {f'CALL {file[:-3]}'} if file != 'WAAM.LS' else set()
        used |= named(r'CALL \w+', program)
    return declared, used


def names_of_kuka(files: dict[str, str]) -> tuple[set[str], set[str]]:
    declared, used = set(), set()
    for file, text in files.items():
        module = file.split('.')[0]
        text = re.sub(r'"[^"]*"', '', text)
        if file.endswith('.dat'):
            declared |= {f'{module} {n}' for n in named(r'DECL \w+ (\w+)=', text)}
        else:
            used |= {f'{module} {n}' for n in named(r'\b(?:XP\d+|WDAT\d+|WP)\b', text)}
            declared |= {f'{n}()' for n in named(r'DEF (WAAM\d+)\(', text)}
            used |= {f'{n}()' for n in named(r'(?m)^(WAAM\d+)\(', text)}
    return declared, used


def names_of_abb(files: dict[str, str]) -> tuple[set[str], set[str]]:
    declared, used = set(), set()
    for file, text in files.items():
        module = file.split('.')[0]
        local = named(r'LOCAL (?:CONST|PERS) \w+ (\w+):=', text)
        declared |= {f'{module} {n}' for n in local}
        body = re.sub(r'(?m)^ *(?:LOCAL )?(?:CONST|PERS) .*$', '', text)
        used |= {f'{module} {n}' for n in named(r'(?<![\w\\])(?:p|v|z|wd|sm)\d+\b', body)}
        declared |= named(r'(?m)^ *PERS wobjdata (\w+):', text) | named(r'PROC (WAAM\d+)', text)
        used |= named(r'WObj:=(\w+)', body) | named(r'(?m)^ *(WAAM\d+);', body)
    return declared, used


NAMES = {'fanuc': names_of_fanuc, 'kuka': names_of_kuka, 'abb': names_of_abb}


@pytest.mark.parametrize('language', LANGUAGES)
@pytest.mark.parametrize('law', ['harmonic', 'plain'])
@pytest.mark.parametrize('positioner', ['none', 'turn'])
def test_what_a_program_declares_is_used_and_the_reverse(language, law, positioner):
    """Over the settings that leave something out: one bead or many, arc off before or after, no voltage, no wait."""
    spec = GridSpec.covering(0.0, 0.0, 0.06, 0.05, 1e-3)
    for size, fanuc, flow in (
        (0.05, FanucSettings(), 0.3),
        (0.006, FanucSettings(lead=-0.2, voltage_output=0), 0.0),
        (0.03, FanucSettings(smoothing=40, registers=False), 0.3),
    ):
        inside = (np.abs(spec.x[None] - 0.03) < size / 2) & (np.abs(spec.y[:, None] - 0.025) < 0.02)
        nominal = HeightGrid(spec, np.where(inside, 0.01, np.nan))
        found = HeightGrid(spec, np.where(inside, 0.006, 0.0))
        plan = plan_restoration(found, nominal, PlanSettings(idle_law=law))
        cell = RobotCell(positioner=positioner, origin=CENTRE, fanuc=fanuc, pre_flow=flow)
        files = LANGUAGES[language][0](plan, cell=cell)
        declared, used = NAMES[language](files)
        assert used and declared == used
        if language == 'fanuc' and fanuc.registers:
            assert ('R[101' in used) == (law == 'plain')
            assert any('R[101]mm/sec' in text for text in files.values()) == (law == 'plain')


def test_fanuc_puts_the_arc_out_after_the_end(small):
    cell = RobotCell(fanuc=FanucSettings(lead=-0.3))
    files = write_ls(small, cell=cell)
    assert 'R[33]=0.30' in files['WAAM.LS'] and 'TA R[33]sec,DO[1]=OFF' in files['WAAM001.LS']
    assert sum(m.arc for m in read_ls(files, cell=cell)) > 10


def test_the_memory_of_a_controller_is_kept(small, monkeypatch):
    monkeypatch.setattr(parts, 'ALL_POINTS', 20)
    with pytest.raises(
        RobotProgramError, match='points in .* KB, the memory of a controller takes 20'
    ):
        write_ls(small)
    monkeypatch.setattr(parts, 'BYTES', 500)
    with pytest.raises(RobotProgramError, match='WAAM001: .* bytes, the controller takes 500'):
        write_rapid(small)


def test_kuka_and_abb_have_their_arc_packages(small):
    cell = RobotCell(positioner='turn', origin=CENTRE, pre_flow=0.4, post_flow=2.0)
    files = write_krl(small, cell=cell, tolerance=20e-6)
    source, data = files['WAAM001.src'], files['WAAM001.dat']
    assert source.count(';FOLD ARCON') == source.count(';FOLD ARCOFF') == 3
    assert data.count('PreFlowTime 0.400') == data.count('PostflowTime 2.000') == 3
    assert 'CIRC XP' in source and ',E1 0.0000,E2 ' in data
    assert files['WAAM.src'].count('$BASE=EK(') == 3  # as it is, lifted, back
    modules = write_rapid(small, cell=cell, tolerance=20e-6)
    text = modules['WAAM001.mod']
    assert text.count('ArcLStart ') == 3 and len(re.findall('Arc[LC]End ', text)) == 3
    assert re.search(r'seamdata sm1:=\[0,0\.400,.*,2\.000\];', text) and 'ArcC ' in text
    assert modules['WAAM.mod'].count('PDispSet') == 2 and 'ActUnit STN1;' in modules['WAAM.mod']
    weld = re.search(r'welddata wd1:=\[10\.0000,0,\[0,0,22\.00,([\d.]+),', text)
    assert float(weld[1]) == pytest.approx(1e3 * read_rapid(modules, cell=cell)[3].feed, abs=1e-3)


@pytest.mark.parametrize('language', LANGUAGES)
def test_dwells_with_the_arc_on_keep_it(language):
    write, read = LANGUAGES[language]
    bead = layer([(0.01, 0.01), (0.03, 0.01)])
    deposit = next(s for s in bead if s.arc)
    stands = deposit.at(kind=Kind.DWELL, end=deposit.start, dwell=0.5, height=0.0)
    crater = deposit.at(kind=Kind.DWELL, start=deposit.end, dwell=0.3, height=0.0)
    at = bead.index(deposit)
    files = write(plan_of([*bead[:at], stands, deposit, crater, *bead[at + 1 :]]))
    laid = [m for m in read(files) if m.arc]
    assert {round(m.feed, 6) for m in laid if math.dist(m.end, deposit.end) < 1e-6} == {
        round(laid[0].feed, 6)
    }
    text = ''.join(files.values())
    assert re.search(r'WAIT +(SEC )?0\.50|WaitTime 0\.5', text)
    assert re.search(r'WAIT +(SEC )?0\.30|WaitTime 0\.3', text)


# ---- what is wrong -------------------------------------------------------------------------------

BROKEN = [
    ('fanuc', 'WAAM001.LS', 'mm/sec', 'furlongs', "line 11, word 3.*'furlongs'.*wanted 'mm/sec'"),
    ('fanuc', 'WAAM001.LS', 'R[72]*', 'R[55]*', r'line \d+, word \d+.*wanted a value in R\[55\]'),
    ('fanuc', 'WAAM001.LS', 'P[3]{', 'P[999]{', r'wanted a position of P\[3\]'),
    ('fanuc', 'WAAM.LS', 'CALL WAAM002', 'CALL NOBODY', 'NOBODY.LS is called but is not there'),
    ('fanuc', 'WAAM001.LS', '/POS', '', '/MN or /POS is missing'),
    ('kuka', 'WAAM001.src', 'LIN XP1\n', 'LIN XP999\n', "line 5, word 2.*wanted the position XP999"),
    ('kuka', 'WAAM001.src', ';FOLD ARCOFF', ';FOLD WEAVE', "word 2 .'WEAVE'.: wanted ARCON, ARCSWI"),
    ('kuka', 'WAAM001.dat', 'X 0.0000', 'X nought', "WAAM001.src, line 5, word 2 .'XP1'.: wanted a number X"),
    ('kuka', 'WAAM001.dat', 'Y 0.0000,', 'Y 0.0000;', "WAAM001.dat, line 5, word 5.*wanted ',' or"),
    ('kuka', 'WAAM001.src', 'LIN XP2\n', 'SPL XP2\n', "'SPL'.: wanted a motion"),
    ('abb', 'WAAM001.mod', 'ArcLStart p', 'ArcQStart p', "'ArcQStart'.: wanted WaitTime or one of"),
    ('abb', 'WAAM001.mod', ',sm1,wd1,fine', ',fine', "wanted a seamdata|wanted fine to be a seamdata"),
    ('abb', 'WAAM001.mod', 'robtarget p1:', 'robtarget q1:', 'wanted p1 to be a robtarget'),
    ('abb', 'WAAM.mod', 'PDispSet [[0,0', 'PDispSet [[0,1', 'wanted a displacement along Z'),
    ('abb', 'WAAM001.mod', 'ENDMODULE', '', 'ENDMODULE is missing'),
]  # fmt: skip


@pytest.mark.parametrize('language, file, old, new, told', BROKEN)
def test_what_is_wrong_is_named_with_its_place(language, file, old, new, told, small):
    write, read = LANGUAGES[language]
    files = write(small)
    assert old in files[file]
    with pytest.raises(RobotProgramError, match=told):
        read(files | {file: files[file].replace(old, new, 1)})


@given(st.data())
@settings(max_examples=50, deadline=None)
def test_damaged_programs_are_read_or_refused(data):
    language = data.draw(st.sampled_from(sorted(LANGUAGES)))
    read = LANGUAGES[language][1]
    files = dict(written(language))
    file = data.draw(st.sampled_from(sorted(files)))
    text = files[file]
    at = data.draw(st.integers(0, len(text)))
    cut = data.draw(st.integers(0, 30))
    put = data.draw(
        st.text(max_size=6)
        | st.sampled_from(
            ['9e999', '[', '{', '-', 'R[3]', '1e308', '{' * 40, '[' * 2000, '\n', ';']
        )
    )
    files[file] = text[:at] + put + text[at + cut :]
    try:
        moves = read(files, cell=TURNS)
    except RobotProgramError as e:
        assert re.search(r'\w+\.(LS|src|dat|mod)', str(e))
    else:
        assert all(math.isfinite(v) for m in moves for v in (*m.end, m.speed, m.feed, *m.wpr))


TURNS = RobotCell(positioner='turn', origin=CENTRE)


@cache
def written(language):
    beads = (ring(0.02, n=12), SQUARE)
    plan = plan_of(layer(*beads), layer(*beads, number=2, z=0.002))
    return LANGUAGES[language][0](plan, cell=TURNS)


@pytest.mark.parametrize(
    'data, told',
    [
        (
            {'positioner': 'spin'},
            'cell.yaml: positioner is .spin., must be one of none, hold, turn, place',
        ),
        ({'corner': -1}, 'cell.yaml: corner is -1, must be between 0 and 0.005'),
        ({'fanuc': {'lead': 99}}, 'cell.yaml: fanuc: lead is 99, must be between -0.5 and 30'),
        ({'abb': {'tool': 'a b'}}, "abb: tool is 'a b', must be a name"),
        ({'kuka': {'tool': 1.5}}, 'kuka: tool is 1.5, must be a whole number'),
        ({'origin': [1, 2]}, r'origin is \(1, 2\), must be three numbers'),
        ({'motor': 1}, 'cell.yaml: motor: there is no such field; known: abb, '),
        ({'kuka': 3}, 'kuka:  must be fields with values'),
        ([1], 'the file must be fields with values'),
        ({'fanuc': {'registers': 'yes'}}, 'registers is .yes., must be true or false'),
    ],
)
def test_a_bad_cell_is_refused_by_field(data, told):
    with pytest.raises(RobotProgramError, match=told):
        cell_of(data, 'cell.yaml')


def test_a_cell_is_read_from_fields():
    cell = cell_of({'positioner': 'turn', 'origin': [0.1, 0, 0], 'fanuc': {'lead': -0.2}}, 'x')
    assert cell.origin == (0.1, 0, 0) and cell.fanuc.lead == -0.2 and cell.axes
    assert cell_of(None, 'empty') == RobotCell()


@given(st.floats(0.1, 3.0), st.floats(2e-3, 0.05), st.sampled_from([0.0, 1e-5, 1e-4]))
@settings(max_examples=10, deadline=None)
def test_corners_are_rounded_off_by_no_more_than_allowed(turn, length, corner):
    end = (0.05 + length * math.cos(turn), 0.01 + length * math.sin(turn))
    plan = plan_of(layer([(0.05 - length, 0.01), (0.05, 0.01), end]))
    cell = RobotCell(corner=corner)
    for write, read in LANGUAGES.values():
        moves = read(write(plan, cell=cell, tolerance=1e-9), cell=cell)
        path = path_of(moves, cell)
        near = np.linalg.norm(path.poses[path.arc][:, :3, 3] - (0.05, 0.01, 0.0), axis=1).min()
        assert near <= corner + 2 * ROUNDED


def test_steps_know_the_way_of_an_arc(small):
    moves = [s.move for s in steps_of(small)]
    arcs = [m for m in moves if m.via]
    assert arcs and all(course(m.start, m).curvature == pytest.approx(50, rel=0.4) for m in arcs)


def steps_of(plan):
    from waam_plan.gcode.compact import fragments

    return [s for f in fragments(plan) for s in steps(f.moves, TURNS)[1]]
