"""Reads KUKA programs of `kuka` back: main program, modules, data lists, records of ArcTech. SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TypeAlias

from robot_line import DEEPEST, NAME, TEXT, Line, Motion

from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import RobotProgramError
from waam_plan.robot.poses import Pose

Value: TypeAlias = 'float | str | dict[str, Value]'
_RECORDS = ('ARCON', 'ARCSWI', 'ARCOFF')
_PASSED = re.compile(  # without effect on the path: what ArcTech does at the move, and the frame of a program
    r'TRIGGER WHEN |ArcMainNG\(#\w+,\w+,WP\)$|;ENDFOLD$|BAS\(#INITMOV,0\)$|\$TOOL=TOOL_DATA\[\d+\]$|\$IPO_MODE=#BASE$|'
    r'PTP \$AXIS_ACT$'
)


@dataclass
class _State:
    cell: RobotCell
    lift: float = 0.0
    speed: float = 0.0
    of_record: bool = False  # the speed is that of the record in force
    blend: float = 0.0
    record: tuple[str, str] | None = None  # kind and name, of the move to come
    weld: tuple[float, float, float] | None = None  # in force: speed, feed m/s, V; None = no arc
    out: list[Motion] = field(default_factory=list)


def read_krl(
    files: dict[str, str], name: str = 'WAAM', cell: RobotCell | None = None
) -> list[Motion]:
    """The motions of a main program with its modules, in order. RobotProgramError naming file, line and word."""
    state = _State(cell or RobotCell())
    data: dict[str, dict[str, Value]] = {}
    for line in _body(files, name):
        if line.maybe(r'\$BASE='):
            _base(line, state)
        elif _passed(line):
            continue
        else:
            part = line.take(r'(\w+)\(\)', 'a base or the call of a module')[1]
            line.end()
            if part not in data:
                data[part] = _data(files, f'{part}.dat')
            for inner in _body(files, part):
                _statement(inner, data[part], state)
    return state.out


def _body(files: dict[str, str], name: str) -> list[Line]:
    """Lines between DEF and END."""
    file = f'{name}.src'
    lines = _lines(files, file)
    begin = next((i for i, x in enumerate(lines) if x.text.startswith('DEF ')), None)
    if begin is None or not any(x.text == 'END' for x in lines[begin:]):
        raise RobotProgramError(f'{file}: DEF or END is missing')
    lines[begin].take(rf'DEF {name}\(\)', f'DEF {name}()')
    lines[begin].end()
    end = next(i for i, x in enumerate(lines) if i > begin and x.text == 'END')
    return lines[begin + 1 : end]


def _lines(files: dict[str, str], file: str) -> list[Line]:
    if file not in files:
        raise RobotProgramError(f'{file} is called but is not there')
    numbered = enumerate(files[file].split('\n'), 1)
    return [Line(file, n, text.strip()) for n, text in numbered if text.strip()]


def _passed(line: Line) -> bool:
    return bool(_PASSED.match(line.text))


def _base(line: Line, state: _State) -> None:
    ahead = 0.0
    if line.maybe(r'EK\(MACHINE_DEF\[\d+\]\.ROOT,MACHINE_DEF\[\d+\]\.MECH_TYPE,'):
        ahead = state.cell.origin[2]
    else:
        line.take(r'BASE_DATA\[\d+\]:', 'BASE_DATA[number]: or EK(...')
    frame = _structure(line, 0)
    line.maybe(r'\)')
    line.end()
    state.lift = _number(line, frame, 'Z') * 1e-3 - ahead


def _statement(line: Line, data: dict[str, Value], state: _State) -> None:
    if line.maybe(r'\$VEL\.CP='):
        state.of_record = bool(line.maybe('gArcBasVelDefinition'))
        if not state.of_record:
            state.speed = line.number_here('a speed')
            if not 0 < state.speed < 10:
                line.refuse('a speed above 0 and below 10 m/s')
        line.end()
    elif line.maybe(r'\$APO\.CDIS='):
        state.blend = line.number_here('a distance') * 1e-3
        if not 0 <= state.blend < 1:
            line.refuse('a distance of 0 to 1000 mm')
        line.end()
    elif line.maybe('WAIT SEC '):
        if line.number_here('a time') < 0:
            line.refuse('a time that is not negative')
        line.end()
    elif line.maybe(';FOLD '):
        kind = line.take('|'.join(_RECORDS), ', '.join(_RECORDS))[0]
        state.record = (kind, line.take(NAME, 'a record')[0])
        line.end()
        if state.record[1] not in data:
            line.refuse(f'{state.record[1]} in the .dat')
    elif line.maybe('LIN '):
        _motion(line, None, data, state)
    elif line.maybe('CIRC '):
        via = _pose(line, data)
        line.take(',', "','")
        _motion(line, via, data, state)
    elif not _passed(line):
        line.fail('a motion, a speed, a blending distance, a wait or a command of ArcTech')


def _motion(line: Line, via: Pose | None, data: dict[str, Value], state: _State) -> None:
    end = _pose(line, data)
    zone = state.blend if line.maybe('C_DIS') else 0.0
    line.end()
    arc = state.weld is not None
    if state.of_record and not state.weld:
        line.fail('a record in force before: the speed comes from it')
    speed, feed, voltage = state.weld or (state.speed, 0.0, 0.0)
    place, through = end.place, via.place if via else None
    motion = Motion(
        (place[0], place[1], place[2] + state.lift),
        (through[0], through[1], through[2] + state.lift) if through else None,
        speed if state.of_record else state.speed,
        arc,
        feed,
        voltage,
        wpr=end.wpr,
        external=end.external if state.cell.axes else (),
        zone=zone,
    )
    if motion.speed <= 0:
        line.refuse('a speed ($VEL.CP)')
    state.out.append(motion)
    _after(line, data, state)


def _after(line: Line, data: dict[str, Value], state: _State) -> None:
    """The record of the move counts from its end on."""
    if state.record is None:
        return
    (kind, name), state.record = state.record, None
    record = data[name]
    part = (
        record.get('Crater' if kind == 'ARCOFF' else 'Weld') if isinstance(record, dict) else None
    )
    if not isinstance(part, dict):
        line.fail(f'{"Crater" if kind == "ARCOFF" else "Weld"} in the record {name}')
    if kind == 'ARCOFF':
        if state.weld is None:
            line.fail('ARCON before ARCOFF')
        state.weld = None
        return
    if (kind == 'ARCON') != (state.weld is None):
        line.fail('ARCOFF before ARCON' if kind == 'ARCON' else 'ARCON before ARCSWI')
    k = state.cell.kuka
    volts = _number(line, part, f'Channel{k.voltage_channel}') if k.voltage_channel else 0.0
    speed = _number(line, part, 'Velocity')
    if not 0 < speed < 10:
        line.fail(f'a Velocity above 0 and below 10 m/s in {name}')
    state.weld = (speed, _number(line, part, f'Channel{k.feed_channel}') / 60, volts)


def _number(line: Line, values: dict[str, Value], name: str) -> float:
    value = values.get(name)
    if not isinstance(value, float):
        line.refuse(f'a number {name}')
    return value


def _pose(line: Line, data: dict[str, Value]) -> Pose:
    name = line.take(NAME, 'a position')[0]
    values = data.get(name)
    if not isinstance(values, dict):
        line.refuse(f'the position {name} in the .dat')
    x, y, z = (_number(line, values, w) * 1e-3 for w in 'XYZ')
    w, p, r = (math.radians(_number(line, values, word)) for word in 'CBA')
    external = tuple(math.radians(_number(line, values, e)) for e in ('E1', 'E2'))
    return Pose((x, y, z), (w, p, r), external)


# ---- data lists ----------------------------------------------------------------------------------


def _data(files: dict[str, str], file: str) -> dict[str, Value]:
    out: dict[str, Value] = {}
    for line in _lines(files, file):
        if line.text.startswith(('&', 'DEFDAT ', 'ENDDAT', ';')):
            continue
        line.take('DECL ', 'DECL')
        line.take(r'(E6POS|stArcDat_T) ', 'E6POS or stArcDat_T')
        name = line.take(NAME, 'a name')[0]
        line.take('=', "'='")
        out[name] = _structure(line, 0)
        line.end()
    return out


def _structure(line: Line, depth: int) -> dict[str, Value]:
    """{NAME value,NAME {...},NAME[] "text"}"""
    if depth > DEEPEST:
        line.fail(f'data that is at most {DEEPEST} deep')
    line.take(r'\{', "'{'")
    out: dict[str, Value] = {}
    while True:
        name = line.take(NAME, 'the name of a component')[0]
        line.maybe(r'\[\]')
        if line.text[line.at : line.at + 1] == '{':
            out[name] = _structure(line, depth + 1)
        elif text := line.maybe(TEXT):
            out[name] = text[0]
        elif word := line.maybe(r'#?[A-Za-z_]\w*'):
            out[name] = word[0]
        else:
            out[name] = line.number_here()
        if line.maybe(r'\}'):
            return out
        line.take(',', "',' or '}'")
