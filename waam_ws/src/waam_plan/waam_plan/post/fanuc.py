"""Programs for a Fanuc controller: TP fragments (.LS) called from a main program (docs/equations.md, S3).

Every fragment holds at most 2000 points and 600 KB. Equal layers are one fragment, called with an offset in PR[1].
Speed and wire feed are written in each motion line and in an analogue output; the arc and the gas are digital outputs,
and the main program ends with source, feed and gas off, gas last. Gas flows before the arc is lit and after it is out.
It is switched during the idle moves (`TB`); the robot waits only where these are too short. `TA` does not serve for
the gas: it takes 0.5 s at most. The robot accelerates by itself, so a straight idle
leg is one line to a FINE point, at the highest speed that was planned on it. `read_ls` reads the programs back.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.plan import Plan
from waam_plan.post.compact import TOLERANCE, Fragment, Move, circle, fragments
from waam_plan.post.gas import Flow, Switch, gas_left, gas_switches
from waam_plan.post.gcode import with_base_feed
from waam_process.segment import Kind, Point

POINTS_PER_FRAGMENT = 2000
BYTES_PER_FRAGMENT = 600_000
TIME_BEFORE_MAX = 30.0  # s, of `TB`


class FanucError(ValueError):
    """A program that cannot be written or read; the text names file and line."""


@dataclass(frozen=True)
class FanucSettings:
    """Numbers of frames and outputs in the cell. orientation: W, P, R of the torch in degrees."""

    user_frame: int = 1
    user_tool: int = 1
    arc_output: int = 1
    gas_output: int = 2
    feed_output: int = 1  # AO, m/min
    orientation: Point = (180.0, 0.0, 0.0)
    lead: float = 0.1  # s before the end of a bead at which its arc output goes off
    smoothing: int = 100  # CNT along a bead
    pre_flow: float = 0.3  # s of gas before the arc is lit
    post_flow: float = 1.0  # s of gas after the arc went off

    def __post_init__(self) -> None:
        """FanucError for times that the controller does not take."""
        for name in ('lead', 'pre_flow', 'post_flow'):
            value = getattr(self, name)
            if not 0 <= value <= TIME_BEFORE_MAX:
                raise FanucError(f'{name} = {value} s is outside 0 to {TIME_BEFORE_MAX:.0f} s')


def write_ls(
    plan: Plan,
    name: str = 'WAAM',
    settings: FanucSettings | None = None,
    tolerance: float = TOLERANCE,
) -> dict[str, str]:
    """File name -> text: the main program `<name>.LS`, its fragments `<name>001.LS` ... FanucError for a bad name."""
    if not re.fullmatch(r'[A-Z][A-Z0-9_]{0,25}', name):
        raise FanucError(f"'{name}' is no program name: capital letters, digits and _, at most 26")
    settings = settings or FanucSettings()
    files: dict[str, str] = {}
    calls: dict[int, list[tuple[str, float]]] = {}
    for fragment in fragments(_with_feeds(plan), tolerance):
        parts = []
        for moves in _split(fragment):
            part = f'{name}{len(files) + 1:03d}'
            files[f'{part}.LS'] = _program(part, _body(moves, settings), settings)
            parts.append(part)
        for number, lift in fragment.levels:
            calls[number] = [(part, lift) for part in parts]
    ordered = [c for number in sorted(calls) for c in calls[number]]
    return {f'{name}.LS': _main(name, ordered, settings), **files}


def _with_feeds(plan: Plan) -> Plan:
    layers = [replace(p, segments=with_base_feed(p.segments, plan.settings)) for p in plan.layers]
    return replace(plan, layers=layers)


def _split(fragment: Fragment) -> list[list[Move]]:
    """Pieces within the limits of the controller; cut only where the arc is off."""
    out: list[list[Move]] = [[]]
    block: list[Move] = []
    for move in [*fragment.moves, None]:
        if move is not None:
            block.append(move)
        ends = move is None or not move.segment.arc
        if ends and block:
            if out[-1] and _points(out[-1]) + _points(block) > POINTS_PER_FRAGMENT:
                out.append([])
            out[-1].extend(block)
            block = []
    for moves in out:
        if _points(moves) > POINTS_PER_FRAGMENT:
            raise FanucError(
                f'a bead of {_points(moves)} points does not fit into a fragment of {POINTS_PER_FRAGMENT}; '
                'raise the tolerance of compact programs'
            )
    return out


def _points(moves: list[Move]) -> int:
    return 1 + sum(m.points for m in moves)


@dataclass
class _Body:
    lines: list[str]
    points: list[Point]

    def point(self, position: Point) -> str:
        self.points.append(position)
        return f'P[{len(self.points)}]'


def _body(moves: list[Move], settings: FanucSettings) -> _Body:
    """Motion lines. The arc is lit at the start of a bead, where the robot stands, and goes off `lead` seconds before
    its end is reached; a bead that ends with a dwell burns to the end of it. The gas is off before and after.
    """
    body = _Body([], [])
    feed = -1.0
    first = moves[0]
    arc = gas = False
    switches = gas_switches(moves, _flow(settings))
    body.lines.append(f'L {body.point(first.start)} {_speed(first)} FINE Offset,PR[1]')
    for i, m in enumerate(moves):
        s = m.segment
        if s.arc and abs(s.wire_feed_speed - feed) > 1e-9:
            feed = s.wire_feed_speed
            body.lines.append(f'AO[{settings.feed_output}]={feed * 60:.3f}')
        if s.arc and not gas:
            body.lines += [_gas(True, settings), *_wait(settings.pre_flow)]
            gas = True
        if s.arc and not arc:
            body.lines.append(f'DO[{settings.arc_output}]=ON')
        arc = s.arc
        gas = switches[i][-1].on if i in switches else gas
        goes_on = i + 1 < len(moves) and moves[i + 1].segment.arc == s.arc
        flows = goes_on and s.arc and moves[i + 1].segment.kind != Kind.DWELL
        stop = f'CNT{settings.smoothing}' if flows else 'FINE'
        if s.kind == Kind.DWELL:
            body.lines += _dwell(s.dwell, switches.get(i, []), settings)
            if s.arc and not goes_on:
                body.lines.append(f'DO[{settings.arc_output}]=OFF')
            continue
        tail = ''.join(
            f' TB {min(w.before, TIME_BEFORE_MAX):.2f}sec,{_gas(w.on, settings)}'
            for w in switches.get(i, [])
        )
        if s.arc and not goes_on:
            tail = f' TB {settings.lead:.2f}sec,DO[{settings.arc_output}]=OFF'
        if m.via:
            body.lines.append(f'C {body.point(m.via)}')
            body.lines.append(f'  {body.point(m.end)} {_speed(m)} {stop} Offset,PR[1]{tail}')
        else:
            body.lines.append(f'L {body.point(m.end)} {_speed(m)} {stop} Offset,PR[1]{tail}')
    if gas:
        body.lines += [*_wait(gas_left(moves, _flow(settings))), _gas(False, settings)]
    return body


def _flow(settings: FanucSettings) -> Flow:
    return Flow(settings.pre_flow, settings.post_flow, settings.lead)


def _gas(on: bool, settings: FanucSettings) -> str:
    return f'DO[{settings.gas_output}]={"ON" if on else "OFF"}'


def _wait(time: float) -> list[str]:
    return [f'WAIT {time:6.2f}(sec)'] if time >= 0.005 else []


def _dwell(time: float, switches: list[Switch], settings: FanucSettings) -> list[str]:
    """A wait with the switches of the gas in it."""
    lines: list[str] = []
    left = time
    for switch in switches:
        lines += [*_wait(left - switch.before), _gas(switch.on, settings)]
        left = switch.before
    return [*lines, *_wait(left)]


def _speed(move: Move) -> str:
    return f'{move.segment.speed * 1e3:.2f}mm/sec'


def _main(name: str, calls: list[tuple[str, float]], settings: FanucSettings) -> str:
    lines = [f'PR[1,{i}]=0' for i in range(1, 7)]
    shift = 0.0
    for part, lift in calls:
        if lift != shift:
            lines.append(f'PR[1,3]={lift * 1e3:.4f}')
            shift = lift
        lines.append(f'CALL {part}')
    off = [
        f'DO[{settings.arc_output}]=OFF',
        f'AO[{settings.feed_output}]=0',
        _gas(False, settings),
    ]
    return _program(name, _Body([*lines, *off], []), settings)


def _program(name: str, body: _Body, settings: FanucSettings) -> str:
    head = [f'UFRAME_NUM={settings.user_frame}', f'UTOOL_NUM={settings.user_tool}']
    numbered: list[str] = []
    count = 0
    for line in [*head, *body.lines]:
        if line.startswith('  '):  # second half of a circular move
            numbered[-1] += '\n    :  ' + line.strip() + '    ;'
            continue
        count += 1
        numbered.append(f'{count:4d}:{line}' + ('' if line.startswith('C ') else '    ;'))
    places = [_place(i, p, settings) for i, p in enumerate(body.points, 1)]
    text = '\n'.join(
        [
            f'/PROG  {name}', '/ATTR', 'OWNER\t\t= WAAM;', 'COMMENT\t\t= "deposition";', f'LINE_COUNT\t= {count};',
            'PROTECT\t\t= READ_WRITE;', 'DEFAULT_GROUP\t= 1,*,*,*,*;', '/MN', *numbered, '/POS', *places, '/END', '',
        ]
    )  # fmt: skip
    if len(text) > BYTES_PER_FRAGMENT:
        raise FanucError(f'{name}.LS: {len(text)} bytes, the controller takes {BYTES_PER_FRAGMENT}')
    return text


def _place(number: int, position: Point, settings: FanucSettings) -> str:
    x, y, z = (f'{v * 1e3:10.4f}' for v in position)
    w, p, r = (f'{v:8.3f}' for v in settings.orientation)
    return (
        f'P[{number}]{{\n   GP1:\n\tUF : {settings.user_frame}, UT : {settings.user_tool},\t'
        f"CONFIG : 'N U T, 0, 0, 0',\n\tX = {x}  mm,\tY = {y}  mm,\tZ = {z}  mm,\n"
        f'\tW = {w} deg,\tP = {p} deg,\tR = {r} deg\n}};'
    )


@dataclass(frozen=True)
class LsMove:
    """A move of a program that was read back. SI; via is None for a line."""

    end: Point
    via: Point | None
    speed: float
    arc: bool
    feed: float


_LINE = re.compile(r'^\s*(\d*):\s*(.*?)\s*;?\s*$')
_MOTION = re.compile(
    r'(?:(?P<k>[LC])\s+)?P\[(?P<p>\d+)\](?:\s+(?P<v>[\d.]+)mm/sec\s+(?:FINE|CNT\d+)(?P<rest>.*))?$'
)
_POSITION = re.compile(
    r'P\[(\d+)\]\{.*?X\s*=\s*(-?[\d.]+)\s*mm,\s*Y\s*=\s*(-?[\d.]+)\s*mm,\s*Z\s*=\s*(-?[\d.]+)\s*mm',
    re.S,
)


def read_ls(
    files: dict[str, str], name: str = 'WAAM', settings: FanucSettings | None = None
) -> list[LsMove]:
    """The path of a main program with its fragments and offsets, in order. FanucError naming file and line."""
    settings = settings or FanucSettings()
    out: list[LsMove] = []
    lift = 0.0
    for number, line in _lines(files, f'{name}.LS'):
        if match := re.fullmatch(r'PR\[1,3\]=(-?[\d.]+)', line):
            lift = float(match[1]) * 1e-3
        elif match := re.fullmatch(r'CALL (\w+)', line):
            out.extend(_read_fragment(files, f'{match[1]}.LS', lift, settings))
        elif not re.fullmatch(r'(DO|AO|PR)\[[\d,]+\]=\S+|U(FRAME|TOOL)_NUM=\d+', line):
            raise FanucError(f"{name}.LS, line {number}: cannot read '{line}'")
    return out


def _lines(files: dict[str, str], file: str) -> list[tuple[int, str]]:
    if file not in files:
        raise FanucError(f'{file} is called but is not there')
    text = files[file]
    if '/MN' not in text or '/POS' not in text:
        raise FanucError(f'{file}: /MN or /POS is missing')
    body = text.split('/MN', 1)[1].split('/POS', 1)[0].strip('\n').split('\n')
    out: list[tuple[int, str]] = []
    for raw in body:
        match = _LINE.match(raw)
        if not match:
            raise FanucError(f"{file}: cannot read '{raw}'")
        out.append((int(match[1] or out[-1][0]), match[2].strip()))
    return out


def _read_fragment(
    files: dict[str, str], file: str, lift: float, settings: FanucSettings
) -> list[LsMove]:
    places = {
        int(n): (float(x) * 1e-3, float(y) * 1e-3, float(z) * 1e-3 + lift)
        for n, x, y, z in _POSITION.findall(files.get(file, ''))
    }
    out: list[LsMove] = []
    arc, feed, via = False, 0.0, None
    for number, line in _lines(files, file):
        if match := re.fullmatch(rf'DO\[{settings.arc_output}\]=(ON|OFF)', line):
            arc = match[1] == 'ON'
        elif match := re.fullmatch(rf'AO\[{settings.feed_output}\]=([\d.]+)', line):
            feed = float(match[1]) / 60
        elif match := _MOTION.match(line):
            if int(match['p']) not in places:
                raise FanucError(f'{file}, line {number}: P[{match["p"]}] has no position')
            place = places[int(match['p'])]
            if match['v'] is None:
                via = place
                continue
            out.append(LsMove(place, via, float(match['v']) * 1e-3, arc, feed if arc else 0.0))
            via = None
            if f'DO[{settings.arc_output}]=OFF' in (match['rest'] or ''):
                arc = False
        elif not re.fullmatch(
            rf'WAIT\s+[\d.]+\(sec\)|U(FRAME|TOOL)_NUM=\d+|DO\[{settings.gas_output}\]=(ON|OFF)',
            line,
        ):
            raise FanucError(f"{file}, line {number}: cannot read '{line}'")
    return out


def sample(start: Point, move: LsMove | Move, step: float = 0.2e-3) -> list[Point]:
    """Points along a move (m), for checks and pictures."""
    a, b = np.array(start), np.array(move.end)
    if move.via is None:
        n = max(1, math.ceil(float(np.linalg.norm(b - a)) / step))
        return [tuple((a + (b - a) * t / n).tolist()) for t in range(1, n + 1)]
    m = np.array(move.via)
    centre, radius = circle(a, m, b)
    u = (a - centre) / radius
    normal = np.cross(m - a, b - a)
    v = np.cross(normal / np.linalg.norm(normal), u)
    sweep = math.atan2((b - centre) @ v, (b - centre) @ u) % (2 * math.pi)
    n = max(2, math.ceil(radius * sweep / step))
    angles = sweep * np.arange(1, n + 1) / n
    points = centre + radius * (np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v)
    return [tuple(p.tolist()) for p in points]
