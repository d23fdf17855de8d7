"""Programs for a Fanuc controller: TP fragments (.LS) called from a main program (docs/equations.md, S3).

Every fragment holds at most 2000 points and 600 KB. Equal layers are one fragment, called with an offset in PR[1].
Speed and wire feed are written at each motion line and in analogue outputs; the arc and the gas are digital outputs,
and the main program ends with source, feed and gas off, gas last. Gas flows before the arc is lit and after it is out.
It is switched during the idle moves (`TB`); the robot waits only where these are too short. `TA` does not serve for
the gas: it takes 0.5 s at most. It puts out the arc where `lead` is below 0. The robot accelerates by itself, so a
straight idle leg is one line to a FINE point, at the highest speed that was planned on it. With a positioner it is
motion group 2 (J1 tilts, J2 turns) and motions are coordinated (COORD).

Registers, as in S3 figure 4.26: R[3] CNT of the beads, R[32], R[33] time before, after the end of a bead at which the
arc goes off, R[50] pre-flow, R[71..73] factor of the wire feed in the first, inner and last bead of a layer, R[91..93]
factor of the voltage, R[101] speed of idle moves in mm/s, of those at `idle_speed` (all with idle_law plain). The main
program sets those that a fragment uses, so they can be changed there.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from waam_plan.gcode.compact import Move
from waam_plan.gcode.gas import Flow, Switch, gas_left, gas_switches
from waam_plan.plan import Plan
from waam_plan.robot.cell import TIME_BEFORE_MAX, RobotCell
from waam_plan.robot.motion import TOLERANCE
from waam_plan.robot.parts import Call, programs
from waam_plan.robot.poses import Pose, Step, steps
from waam_process.segment import Kind

CNT, TB_ARC, TA_ARC, PRE_FLOW, IDLE = 3, 32, 33, 50, 101  # registers
FEED, VOLTAGE = 71, 91  # the first of three each
NOW_FEED, NOW_VOLTAGE = 10, 11  # what is sent to the outputs


def write_ls(
    plan: Plan, name: str = 'WAAM', cell: RobotCell | None = None, tolerance: float = TOLERANCE
) -> dict[str, str]:
    """File name -> text: the main program `<name>.LS`, its fragments `<name>001.LS` ... RobotProgramError for a name
    that is none and beyond the limits of the controller."""
    cell = cell or RobotCell()
    idle = plan.settings.idle_speed
    found = programs(
        plan, name, tolerance, lambda part, moves: [_program(part, _body(moves, cell, idle), cell)]
    )
    parts = {f'{part}.LS': text[0] for part, text in found.texts.items()}
    used = {int(n) for text in parts.values() for n in re.findall(r'\bR\[(\d+)\]', text)}
    return {f'{name}.LS': _main(name, found.calls, cell, _registers(cell, idle, used)), **parts}


@dataclass
class _Body:
    lines: list[str]
    poses: list[Pose]

    def point(self, pose: Pose) -> str:
        self.poses.append(pose)
        return f'P[{len(self.poses)}]'


@dataclass
class _Writer:
    """Motion lines of one fragment. The arc is lit at the start of a bead, where the robot stands, and goes off `lead`
    seconds before its end is reached; a bead that ends with a dwell burns to the end of it. The gas is off before and
    after."""

    cell: RobotCell
    idle: float  # m/s
    body: _Body
    set_to: tuple[float, float, int] = (-1.0, -1.0, -1)  # feed, voltage, role
    arc: bool = False
    gas: bool = False

    def start(self, pose: Pose, first: Move) -> None:
        self._line('L', pose, self._speed(first), 'FINE', '')

    def setpoints(self, step: Step) -> None:
        """Wire and voltage, where they change."""
        s, f = step.move.segment, self.cell.fanuc
        now = (s.wire_feed_speed, s.voltage, step.role)
        if not s.arc or all(abs(a - b) <= 1e-9 for a, b in zip(now, self.set_to, strict=True)):
            return
        before, self.set_to = self.set_to, now
        for value, last, output, factor, register in (
            (now[0] * 60, before[0] * 60, f.feed_output, FEED, NOW_FEED),
            (now[1], before[1], f.voltage_output, VOLTAGE, NOW_VOLTAGE),
        ):
            if not output or (
                abs(value - last) < 1e-9 and (before[2] == now[2] or not f.registers)
            ):
                continue
            if f.registers:
                self.body.lines.append(f'R[{register}]=R[{factor + step.role}]*{value:.3f}')
                self.body.lines.append(f'AO[{output}]=R[{register}]')
            else:
                self.body.lines.append(f'AO[{output}]={value:.3f}')

    def light(self, step: Step) -> None:
        """Gas, then the arc, at the start of a bead."""
        f = self.cell.fanuc
        if step.move.segment.arc and not self.gas:
            self.body.lines.append(_gas(True, self.cell))
            if f.registers and self.cell.pre_flow >= 0.005:
                self.body.lines.append(f'WAIT R[{PRE_FLOW}]')
            else:
                self.body.lines += _wait(self.cell.pre_flow)
            self.gas = True
        if step.move.segment.arc and not self.arc:
            self.body.lines.append(f'DO[{f.arc_output}]=ON')
        self.arc = step.move.segment.arc

    def dwell(self, step: Step, switches: list[Switch], goes_on: bool) -> None:
        s = step.move.segment
        self.body.lines += _dwell(s.dwell, switches, self.cell)
        if s.arc and not goes_on:
            self.body.lines.append(f'DO[{self.cell.fanuc.arc_output}]=OFF')

    def motion(self, step: Step, switches: list[Switch], goes_on: bool, flows: bool) -> None:
        tail = ''.join(
            f' TB {min(w.before, TIME_BEFORE_MAX):.2f}sec,{_gas(w.on, self.cell)}' for w in switches
        )
        if step.move.segment.arc and not goes_on:
            tail = self._arc_off()
        stop = self._cnt(step) if flows else 'FINE'
        speed = self._speed(step.move)
        if step.via:
            self.body.lines.append(f'C {self.body.point(step.via)}')
            self._line(' ', step.end, speed, stop, tail)
        else:
            self._line('L', step.end, speed, stop, tail)

    def _line(self, kind: str, pose: Pose, speed: str, stop: str, tail: str) -> None:
        together = ' COORD' if self.cell.axes else ''
        text = f'{kind} {self.body.point(pose)} {speed} {stop}{together} Offset,PR[1]{tail}'
        self.body.lines.append(text)

    def _arc_off(self) -> str:
        f = self.cell.fanuc
        word, time, register = ('TB', f.lead, TB_ARC) if f.lead >= 0 else ('TA', -f.lead, TA_ARC)
        when = f'R[{register}]sec' if f.registers else f'{time:.2f}sec'
        return f' {word} {when},DO[{f.arc_output}]=OFF'

    def _cnt(self, step: Step) -> str:
        """The controller evens out a corner over `blend_time` at CNT100, and over a share of it below."""
        f = self.cell.fanuc
        whole = step.move.segment.speed * f.blend_time / 2  # m before the corner
        share = step.zone / whole if step.bend * whole > 4 * self.cell.corner else 1.0
        cnt = min(f.smoothing, math.floor(100 * share + 1e-9))
        return f'CNT R[{CNT}]' if f.registers and cnt == f.smoothing else f'CNT{cnt}'

    def _speed(self, move: Move) -> str:
        s = move.segment
        if self.cell.fanuc.registers and not s.arc and abs(s.speed - self.idle) < 1e-9:
            return f'R[{IDLE}]mm/sec'
        return f'{s.speed * 1e3:.2f}mm/sec'


def _body(moves: list[Move], cell: RobotCell, idle: float) -> _Body:
    start, found = steps(moves, cell)
    moves = [s.move for s in found]
    writer = _Writer(cell, idle, _Body([], []))
    switches = gas_switches(moves, _flow(cell))
    writer.start(start, moves[0])
    for i, step in enumerate(found):
        s = step.move.segment
        writer.setpoints(step)
        writer.light(step)
        if i in switches:
            writer.gas = switches[i][-1].on
        goes_on = i + 1 < len(moves) and moves[i + 1].segment.arc == s.arc
        flows = goes_on and s.arc and moves[i + 1].segment.kind != Kind.DWELL
        if s.kind == Kind.DWELL:
            writer.dwell(step, switches.get(i, []), goes_on)
        else:
            writer.motion(step, switches.get(i, []), goes_on, flows)
    if writer.gas:
        writer.body.lines += [*_wait(gas_left(moves, _flow(cell))), _gas(False, cell)]
    return writer.body


def _flow(cell: RobotCell) -> Flow:
    return Flow(cell.pre_flow, cell.post_flow, cell.fanuc.lead)


def _gas(on: bool, cell: RobotCell) -> str:
    return f'DO[{cell.fanuc.gas_output}]={"ON" if on else "OFF"}'


def _wait(time: float) -> list[str]:
    return [f'WAIT {time:6.2f}(sec)'] if time >= 0.005 else []


def _dwell(time: float, switches: list[Switch], cell: RobotCell) -> list[str]:
    """A wait with the switches of the gas in it."""
    lines: list[str] = []
    left = time
    for switch in switches:
        lines += [*_wait(left - switch.before), _gas(switch.on, cell)]
        left = switch.before
    return [*lines, *_wait(left)]


def _main(name: str, calls: list[Call], cell: RobotCell, registers: list[str]) -> str:
    f = cell.fanuc
    lines = registers + [f'PR[1,{i}]=0' for i in range(1, 7)]
    shift = 0.0
    for part, lift in calls:
        if lift != shift:
            lines.append(f'PR[1,3]={lift * 1e3:.4f}')
            shift = lift
        lines.append(f'CALL {part}')
    lines += [f'DO[{f.arc_output}]=OFF', f'AO[{f.feed_output}]=0', _gas(False, cell)]
    return _program(name, _Body(lines, []), cell)


def _registers(cell: RobotCell, idle: float, used: set[int]) -> list[str]:
    """Those of the numbers `used` that are parameters."""
    f = cell.fanuc
    values = {
        CNT: f'{f.smoothing}',
        TB_ARC: f'{max(f.lead, 0.0):.2f}',
        TA_ARC: f'{max(-f.lead, 0.0):.2f}',
        PRE_FLOW: f'{cell.pre_flow:.2f}',
        IDLE: f'{idle * 1e3:.2f}',
    }
    values |= {first + i: '1' for first in (FEED, VOLTAGE) for i in range(3)}
    return [f'R[{n}]={text}' for n, text in sorted(values.items()) if n in used]


def _program(name: str, body: _Body, cell: RobotCell) -> str:
    f = cell.fanuc
    head = [f'UFRAME_NUM={f.user_frame}', f'UTOOL_NUM={f.user_tool}']
    numbered: list[str] = []
    count = 0
    for line in [*head, *body.lines]:
        if line.startswith('  '):  # second half of a circular move
            numbered[-1] += '\n    :  ' + line.strip() + '    ;'
            continue
        count += 1
        numbered.append(f'{count:4d}:{line}' + ('' if line.startswith('C ') else '    ;'))
    places = [_place(i, p, cell) for i, p in enumerate(body.poses, 1)]
    groups = '1,1,*,*,*' if cell.axes else '1,*,*,*,*'
    return '\n'.join(
        [
            f'/PROG  {name}', '/ATTR', 'OWNER\t\t= WAAM;', 'COMMENT\t\t= "deposition";', f'LINE_COUNT\t= {count};',
            'PROTECT\t\t= READ_WRITE;', f'DEFAULT_GROUP\t= {groups};', '/MN', *numbered, '/POS', *places, '/END', '',
        ]
    )  # fmt: skip


def _place(number: int, pose: Pose, cell: RobotCell) -> str:
    f = cell.fanuc
    x, y, z = (f'{v * 1e3:10.4f}' for v in pose.place)
    w, p, r = (f'{math.degrees(v):8.3f}' for v in pose.wpr)
    text = (
        f'P[{number}]{{\n   GP1:\n\tUF : {f.user_frame}, UT : {f.user_tool},\t'
        f"CONFIG : 'N U T, 0, 0, 0',\n\tX = {x}  mm,\tY = {y}  mm,\tZ = {z}  mm,\n"
        f'\tW = {w} deg,\tP = {p} deg,\tR = {r} deg\n'
    )
    if pose.external:
        b, c = (f'{math.degrees(v):9.3f}' for v in pose.external)
        text += (
            f'   GP2:\n\tUF : {f.user_frame}, UT : {f.user_tool},\t\n\tJ1= {b} deg,\tJ2= {c} deg\n'
        )
    return text + '};'
