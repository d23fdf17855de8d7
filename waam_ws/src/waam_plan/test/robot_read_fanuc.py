"""Reads Fanuc programs of `fanuc` back: main program, fragments, registers, offsets. SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from robot_line import Line, Motion

from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import RobotProgramError
from waam_plan.robot.poses import Pose

_PLACE = r'P\[(\d{1,9})\]'
_HEAD = re.compile(r'\s*(\d{1,9})?:(.*?);?\s*$', re.S)
_DEEPEST = 100_000  # calls


@dataclass
class _State:
    """Registers, offset and outputs while a program runs."""

    cell: RobotCell
    registers: dict[int, float] = field(default_factory=dict)
    lift: float = 0.0
    arc: bool = False
    feed: float = 0.0
    voltage: float = 0.0
    calls: int = 0
    out: list[Motion] = field(default_factory=list)


def read_ls(
    files: dict[str, str], name: str = 'WAAM', cell: RobotCell | None = None
) -> list[Motion]:
    """The motions of a main program with its fragments and offsets, in order. RobotProgramError naming file, line and
    word."""
    state = _State(cell or RobotCell())
    _run(files, f'{name}.LS', state, top=True)
    return state.out


def _run(files: dict[str, str], file: str, state: _State, top: bool = False) -> None:
    if file not in files:
        raise RobotProgramError(f'{file} is called but is not there')
    text = files[file]
    if '/MN' not in text or '/POS' not in text:
        raise RobotProgramError(f'{file}: /MN or /POS is missing')
    before, body = text.split('/MN', 1)
    body, after = body.split('/POS', 1)
    offset = before.count('\n')
    places = _places(file, after, offset + body.count('\n'))
    via: Pose | None = None
    number = offset
    for k, raw in enumerate(body.split('\n'), offset + 1):
        if not raw.strip():
            continue
        match = _HEAD.match(raw)
        if not match:
            Line(file, k, raw).fail("a line number and ':'")
        number = k
        line = Line(file, number, match[2])
        if via is not None:
            _motion(line, places, via, state)
            via = None
        elif line.maybe('C '):
            via = _place_of(line, places)
            line.end()
        elif line.maybe('L '):
            _motion(line, places, None, state)
        elif top and line.maybe('CALL '):
            state.calls += 1
            if state.calls > _DEEPEST:
                line.fail(f'at most {_DEEPEST} calls')
            called = line.take(r'\w+', 'a program')[0]
            line.end()
            _run(files, f'{called}.LS', state)
        else:
            _statement(line, state)
    if via is not None:
        raise RobotProgramError(f'{file}, line {number}: the arc has no end')


def _statement(line: Line, state: _State) -> None:
    """Registers, outputs, waits."""
    f = state.cell.fanuc
    if line.maybe(r'PR\[1,'):
        axis = line.count()
        line.take(r'\]=', "']='")
        value = line.number_here()
        if axis == 3:
            state.lift = value * 1e-3
        elif value:
            line.refuse('an offset along Z only')
    elif line.maybe(r'R\['):
        register = line.count()
        line.take(r'\]=', "']='")
        value = _value(line, state)
        if line.maybe(r'\*'):
            value *= _value(line, state)
        state.registers[register] = value
    elif line.maybe(r'AO\['):
        output = line.count()
        line.take(r'\]=', "']='")
        value = _value(line, state)
        if output == f.feed_output:
            state.feed = value / 60
        elif output == f.voltage_output:
            state.voltage = value
    elif line.maybe(r'WAIT '):
        if _value(line, state) < 0:
            line.refuse('a time')
        line.maybe(r'\(sec\)')
    elif line.maybe(r'U(FRAME|TOOL)_NUM='):
        line.count()
    else:
        _output(line, state)
    line.end()


def _output(line: Line, state: _State) -> None:
    line.take(r'DO\[', 'a motion, a register, an output, a wait or a call')
    output = line.count()
    on = line.take(r'\]=(ON|OFF)', "']=ON' or ']=OFF'")[1] == 'ON'
    if output == state.cell.fanuc.arc_output:
        state.arc = on


def _value(line: Line, state: _State) -> float:
    """A number or what a register holds."""
    if not line.maybe(r'R\['):
        return line.number_here('a number or a register')
    register = line.count()
    line.take(r'\]', "']'")
    if register not in state.registers:
        line.refuse(f'a value in R[{register}]')
    return state.registers[register]


def _place_of(line: Line, places: dict[int, Pose]) -> Pose:
    number = int(line.take(_PLACE, 'P[number]')[1])
    if number not in places:
        line.refuse(f'a position of P[{number}]')
    return places[number]


def _motion(line: Line, places: dict[int, Pose], via: Pose | None, state: _State) -> None:
    end = _place_of(line, places)
    speed = _value(line, state) * 1e-3
    line.take('mm/sec', "'mm/sec'")
    if not 0 < speed < 10:
        line.refuse('a speed above 0 and below 10000 mm/sec')
    zone = 0.0
    if not line.maybe('FINE'):
        line.take('CNT', "'FINE' or 'CNT'")
        cnt = _value(line, state)
        if not 0 <= cnt <= 100:
            line.refuse('CNT of 0 to 100')
        zone = cnt / 100 * speed * state.cell.fanuc.blend_time / 2
    out = _options(line, state)
    motion = Motion(
        _lifted(end.place, state.lift),
        _lifted(via.place, state.lift) if via else None,
        speed,
        state.arc,
        state.feed if state.arc else 0.0,
        state.voltage if state.arc else 0.0,
        wpr=end.wpr,
        external=end.external,
        zone=zone,
    )
    state.out.append(motion)
    if out:
        state.arc = False


def _options(line: Line, state: _State) -> bool:
    """COORD, offset and switches; whether the arc goes off at the end."""
    out = False
    while not line.done:
        if line.maybe('COORD'):
            if not state.cell.axes:
                line.refuse('no COORD without a positioner')
        elif line.maybe(r'Offset,PR\[1\]'):
            pass
        else:
            line.take(r'T[AB] ', 'COORD, Offset, TB or TA')
            _value(line, state)
            line.take('sec,', "'sec,'")
            was = state.arc
            _output(line, state)
            out = out or (was and not state.arc)
            state.arc = was
    return out


def _lifted(p: tuple[float, float, float], lift: float) -> tuple[float, float, float]:
    return (p[0], p[1], p[2] + lift)


def _places(file: str, text: str, offset: int) -> dict[int, Pose]:
    """Positions, with the axes of group 2 where they stand."""
    out: dict[int, Pose] = {}
    number, values = 0, {}  # type: ignore[var-annotated]
    for k, raw in enumerate(text.split('\n'), offset + 1):
        line = Line(file, k, raw)
        if match := line.maybe(_PLACE + r'\{'):
            number, values = int(match[1]), {}
        elif line.maybe(r'\};'):
            out[number] = _pose(line, values)
        elif number:
            for word, value in _words(line):
                values[word] = value
    return out


def _words(line: Line) -> list[tuple[str, float]]:
    """X = 1.0 mm, and so on; what is no such word is passed over."""
    found = []
    while not line.done:
        match = line.maybe(r'([XYZWPR]|J[12])\s*=\s*')
        if not match:
            if not line.maybe(r"[^\t,]*'[^']*',?") and not line.maybe(r'[^\t,]+,?|,'):
                break
            continue
        found.append((match[1], line.number_here()))
        line.maybe(r'(mm|deg),?')
    return found


def _pose(line: Line, values: dict[str, float]) -> Pose:
    missing = [w for w in 'XYZWPR' if w not in values]
    if missing:
        line.refuse(f'{missing[0]} of the position')
    x, y, z = (values[w] * 1e-3 for w in 'XYZ')
    w, p, r = (math.radians(values[word]) for word in 'WPR')
    external = tuple(math.radians(values[j]) for j in ('J1', 'J2') if j in values)
    if len(external) == 1:
        line.refuse('both J1 and J2 of the position')
    return Pose((x, y, z), (w, p, r), external)
