"""Reads ABB programs of `abb` back: modules, data, instructions of RobotWare Arc. SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from robot_line import DEEPEST, NAME, TEXT, Line, Motion

from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import RobotProgramError
from waam_plan.robot.poses import Pose
from waam_process.segment import Point
from waam_robot.frames import wpr

Value: TypeAlias = 'float | str | list[Value]'
KINDS = ('robtarget', 'speeddata', 'zonedata', 'welddata', 'seamdata', 'wobjdata')
NO_AXIS = 8e9  # an axis that is not there stands at 9E+09


@dataclass
class _State:
    cell: RobotCell
    lift: float = 0.0
    arc: bool = False
    out: list[Motion] = field(default_factory=list)


@dataclass
class _Module:
    """data: of every kind, by name, with the line that declares it; lines: of the procedure."""

    data: dict[str, tuple[str, Value]]
    lines: list[Line]


def read_rapid(
    files: dict[str, str], name: str = 'WAAM', cell: RobotCell | None = None
) -> list[Motion]:
    """The motions of a main module with its procedures, in order. RobotProgramError naming file, line and word."""
    state = _State(cell or RobotCell())
    modules: dict[str, _Module] = {}
    for line in _load(files, name).lines:
        if line.maybe(r'(ActUnit \w+|ConfL\\Off);'):
            line.end()
        elif line.maybe('PDispOff;'):
            state.lift = 0.0
            line.end()
        elif line.maybe('PDispSet '):
            state.lift = _lift(line)
        else:
            part = line.take(r'(\w+);', 'a displacement or the call of a procedure')[1]
            line.end()
            if part not in modules:
                modules[part] = _load(files, part)
            for inner in modules[part].lines:
                _instruction(inner.again(), modules[part], state)
    return state.out


def _lift(line: Line) -> float:
    value = _value(line, 0)
    line.take(';', "';'")
    line.end()
    place = value[0] if isinstance(value, list) and len(value) == 2 else None
    if not isinstance(place, list) or len(place) != 3 or place[:2] != [0.0, 0.0]:
        line.refuse('a displacement along Z, [[0,0,Z],[1,0,0,0]]')
    z = place[2]
    return z * 1e-3 if isinstance(z, float) else line.refuse('a number for Z')


def _load(files: dict[str, str], name: str) -> _Module:
    file = f'{name}.mod'
    if file not in files:
        raise RobotProgramError(f'{file} is called but is not there')
    module = _Module({}, [])
    inside = None
    for number, raw in enumerate(files[file].split('\n'), 1):
        line = Line(file, number, raw)
        if line.done or line.maybe('!'):
            continue
        if inside is None:
            line.take(rf'MODULE m{name}(?!\w)', f'MODULE m{name}')
            line.end()
            inside = 'module'
        elif inside == 'module':
            inside = _declaration(line, module, name)
        elif inside == 'procedure':
            if line.maybe('ENDPROC'):
                line.end()
                inside = 'module'
            else:
                module.lines.append(line)
        else:
            line.fail('nothing after ENDMODULE')
    if inside != 'end':
        raise RobotProgramError(f'{file}: ENDMODULE is missing')
    return module


def _declaration(line: Line, module: _Module, name: str) -> str:
    """What comes after this line."""
    if line.maybe('ENDMODULE'):
        line.end()
        return 'end'
    if line.maybe('PROC '):
        line.take(rf'{name}\(\)', f'{name}()')
        line.end()
        return 'procedure'
    line.maybe('LOCAL ')
    line.take('CONST |PERS ', 'CONST, PERS, PROC or ENDMODULE')
    kind = line.take('|'.join(KINDS), ', '.join(KINDS))[0]
    declared = line.take(NAME, 'a name')[0]
    line.take(':=', "':='")
    module.data[declared] = (kind, _value(line, 0))
    line.take(';', "';'")
    line.end()
    return 'module'


def _value(line: Line, depth: int) -> Value:
    """[value, ...], a number, a text or a name."""
    if depth > DEEPEST:
        line.fail(f'data that is at most {DEEPEST} deep')
    if line.maybe(r'\['):
        out: list[Value] = [_value(line, depth + 1)]
        while not line.maybe(r'\]'):
            line.take(',', "',' or ']'")
            out.append(_value(line, depth + 1))
        return out
    if text := line.maybe(TEXT):
        return text[0]
    if name := line.maybe(NAME):
        return name[0]
    return line.number_here()


def _instruction(line: Line, module: _Module, state: _State) -> None:
    if line.maybe('WaitTime '):
        if line.number_here('a time') < 0:
            line.refuse('a time that is not negative')
        line.take(';', "';'")
        line.end()
        return
    kinds = 'MoveL|ArcLStart|ArcLEnd|ArcCEnd|ArcL|ArcC'
    kind = line.take(f'({kinds}) ', f'WaitTime or one of {kinds}')[1]
    lays = kind in ('ArcL', 'ArcC', 'ArcLEnd', 'ArcCEnd')
    if lays != state.arc:
        line.refuse('ArcLStart first' if lays else 'ArcLEnd or ArcCEnd first')
    via = _pose(line, module, state) if kind.startswith('ArcC') else None
    if via:
        line.take(',', "','")
    end = _pose(line, module, state)
    line.take(',', "','")
    speed = _numbers(line, module, 'speeddata', 4)[0] * 1e-3
    line.take(',', "','")
    feed = volts = 0.0
    if kind != 'MoveL':
        _numbers(line, module, 'seamdata', 1)
        line.take(',', "','")
        weld = _weld(line, module)
        line.take(',', "','")
        if lays:
            speed, feed, volts = weld
    zone = _zone(line, module)
    line.take(',', "','")
    line.take(r'\w+\\WObj:=wobjWaam;', 'a tool and \\WObj:=wobjWaam;')
    line.end()
    if not 0 < speed < 10:
        line.refuse('a speed above 0 and below 10000 mm/s')
    state.out.append(
        Motion(
            end.place, via.place if via else None, speed, lays, feed, volts,
            wpr=end.wpr, external=end.external, zone=zone,
        )
    )  # fmt: skip
    state.arc = kind in ('ArcLStart', 'ArcL', 'ArcC')


def _numbers(line: Line, module: _Module, kind: str, count: int) -> list[float]:
    """The first numbers of a piece of data."""
    value = _data(line, module, kind)
    found = [v for v in value[:count] if isinstance(v, float)]
    if len(found) < count:
        line.refuse(f'{count} numbers in the {kind}')
    return found


def _data(line: Line, module: _Module, kind: str) -> list[Value]:
    name = line.take(NAME, f'a {kind}')[0]
    declared, value = module.data.get(name, ('', ''))
    if declared != kind or not isinstance(value, list):
        line.refuse(f'{name} to be a {kind} of this module')
    return value


def _zone(line: Line, module: _Module) -> float:
    """m"""
    if line.maybe(r'fine(?!\w)'):
        return 0.0
    value = _data(line, module, 'zonedata')
    size = value[1] if len(value) > 1 else None
    if not isinstance(size, float) or not 0 <= size <= 1000:
        line.refuse('a zone of 0 to 1000 mm')
    return size * 1e-3


def _weld(line: Line, module: _Module) -> tuple[float, float, float]:
    """Travel, wire m/s, V."""
    value = _data(line, module, 'welddata')
    arc = value[2] if len(value) == 4 else None
    numbers = [value[0], *arc[2:4]] if isinstance(arc, list) and len(arc) == 9 else []
    found = [v for v in numbers if isinstance(v, float)]
    if len(found) < 3:
        line.refuse('welddata of four parts with arc data of nine numbers')
    return found[0] * 1e-3, found[2] * 1e-3, found[1]


def _pose(line: Line, module: _Module, state: _State) -> Pose:
    value = _data(line, module, 'robtarget')
    parts = [[v for v in p if isinstance(v, float)] for p in value if isinstance(p, list)]
    if [len(p) for p in parts] != [3, 4, 4, 6]:
        line.refuse('a robtarget of 3, 4, 4 and 6 numbers')
    place, turn, _, outer = parts
    size = math.sqrt(sum(v * v for v in turn)) if max(map(abs, turn)) < 2 else 0.0
    if abs(size - 1) > 1e-3:
        line.refuse('a quaternion of length 1')
    a, b, c, d = (v / size for v in turn)
    x, y, z = (v * 1e-3 for v in place)
    external = tuple(math.radians(v) for v in outer[:2] if v < NO_AXIS)
    return Pose((x, y, z + state.lift), wpr_of((a, b, c, d)), external)


def wpr_of(q: tuple[float, float, float, float]) -> Point:
    """W, P, R of a quaternion of unit length, rad."""
    w, x, y, z = q
    frame = np.eye(4)
    frame[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    a, b, c = wpr(frame).tolist()
    return (a, b, c)
