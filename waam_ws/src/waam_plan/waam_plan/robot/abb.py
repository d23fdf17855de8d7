"""Programs for an ABB controller: RAPID modules called from a main module.

Arc, wire and gas are the instructions of RobotWare Arc (ArcWare): ArcLStart moves to the start of a bead and lights the
arc, ArcL and ArcC lay it, ArcLEnd or ArcCEnd put it out. seamdata has the gas before and after, welddata the travel
speed, wire and voltage of the move to its point (SI_UNITS: mm/s, V). Equal layers are one procedure, called with a
program displacement. With a positioner the work object moves with its mechanical unit; eax_a tilts and eax_b turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from waam_plan.gcode.compact import Move
from waam_plan.plan import Plan
from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import TOLERANCE
from waam_plan.robot.parts import Call, Setpoints, programs, welds
from waam_plan.robot.poses import Pose, Step, steps
from waam_process.segment import Kind, Point

UNUSED = '9E+09'
NO_ARC = '[0,0,0,0,0,0,0,0,0]'


def write_rapid(
    plan: Plan, name: str = 'WAAM', cell: RobotCell | None = None, tolerance: float = TOLERANCE
) -> dict[str, str]:
    """File name -> text: `<name>.mod` with the procedure `<name>` and, for every fragment, one of its own.
    RobotProgramError for a name that is none and beyond the limits of the controller."""
    cell = cell or RobotCell()
    found = programs(plan, name, tolerance, lambda part, moves: [_module(part, moves, cell)])
    parts = {f'{part}.mod': texts[0] for part, texts in found.texts.items()}
    return {f'{name}.mod': _main(name, found.calls, cell), **parts}


def quaternion(wpr: Point) -> tuple[float, float, float, float]:
    """(q1, q2, q3, q4), the real part first, of R = Rz(R) Ry(P) Rx(W)."""
    (cw, sw), (cp, sp), (cr, sr) = ((math.cos(v / 2), math.sin(v / 2)) for v in wpr)
    return (
        cr * cp * cw + sr * sp * sw,
        cr * cp * sw - sr * sp * cw,
        cr * sp * cw + sr * cp * sw,
        sr * cp * cw - cr * sp * sw,
    )


@dataclass
class _Module:
    name: str
    cell: RobotCell
    data: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    points: int = 0
    known: dict[str, str] = field(default_factory=dict)  # value -> name

    def point(self, pose: Pose) -> str:
        self.points += 1
        place = ','.join(f'{v * 1e3:.4f}' for v in pose.place)
        turn = ','.join(f'{v:.9f}' for v in quaternion(pose.wpr))
        outer = [f'{math.degrees(v):.4f}' for v in pose.external] + [UNUSED] * 6
        self.data.append(
            f'LOCAL CONST robtarget p{self.points}:=[[{place}],[{turn}],[0,0,0,0],[{",".join(outer[:6])}]];'
        )
        return f'p{self.points}'

    def constant(self, kind: str, prefix: str, value: str) -> str:
        """The name of a piece of data; equal ones are declared once."""
        key = f'{kind} {value}'
        if key not in self.known:
            self.known[key] = f'{prefix}{sum(k.startswith(kind) for k in self.known) + 1}'
            storage = 'LOCAL CONST' if kind in ('speeddata', 'zonedata') else 'LOCAL PERS'
            self.data.append(f'{storage} {kind} {self.known[key]}:={value};')
        return self.known[key]

    def speed(self, speed: float) -> str:
        return self.constant('speeddata', 'v', f'[{speed * 1e3:.3f},500,5000,1000]')

    def zone(self, zone: float) -> str:
        if zone <= 0:
            return 'fine'
        size = f'{zone * 1e3:.2f}'
        return self.constant('zonedata', 'z', f'[FALSE,{size},{size},{size},1,{size},1]')

    def weld(self, weld: Setpoints) -> str:
        speed, feed, volts = weld
        arc = f'[0,0,{volts:.2f},{feed * 1e3 / 60:.4f},0,0,0,0,0]'
        return self.constant('welddata', 'wd', f'[{speed * 1e3:.4f},0,{arc},{NO_ARC}]')

    def end(self, zone: float) -> str:
        return f'{self.zone(zone)},{self.cell.abb.tool}\\WObj:=wobjWaam;'

    def move(self, pose: Pose, speed: float) -> None:
        self.lines.append(f'MoveL {self.point(pose)},{self.speed(speed)},{self.end(0.0)}')

    def start(self, pose: Pose, speed: float, weld: Setpoints) -> None:
        words = f'{self.point(pose)},{self.speed(speed)},sm1,{self.weld(weld)},{self.end(0.0)}'
        self.lines.append(f'ArcLStart {words}')

    def bead(self, step: Step, weld: Setpoints, last: bool) -> None:
        kind = ('ArcC' if step.via else 'ArcL') + ('End' if last else '')
        via = f'{self.point(step.via)},' if step.via else ''
        zone = 0.0 if last else step.zone
        speed = self.speed(weld[0])
        words = f'{via}{self.point(step.end)},{speed},sm1,{self.weld(weld)},{self.end(zone)}'
        self.lines.append(f'{kind} {words}')


def _module(name: str, moves: list[Move], cell: RobotCell) -> str:
    start, found = steps(moves, cell)
    weld = [*welds([s.move for s in found]), None]
    module = _Module(name, cell)
    flow = f'[0,{cell.pre_flow:.3f},{NO_ARC},0,0,0,0,0,{NO_ARC},0,0,{NO_ARC},0,0,{NO_ARC},{cell.post_flow:.3f}]'
    if any(weld):
        module.data.append(f'LOCAL PERS seamdata sm1:={flow};')
    first = found[0].move.segment.speed
    if weld[0]:
        module.start(start, first, weld[0])
    else:
        module.move(start, first)
    last = start
    for n, step in enumerate(found):
        _step(module, step, weld[n], weld[n + 1], last)
        last = step.end
    body = [f'  {line}' for line in module.data]
    body += [f'  PROC {name}()', *(f'    {line}' for line in module.lines), '  ENDPROC']
    return '\n'.join([f'MODULE m{name}', *body, 'ENDMODULE', ''])


def _step(
    module: _Module, step: Step, now: Setpoints | None, after: Setpoints | None, last: Pose
) -> None:
    """now, after: setpoints of this move and the next, None with the arc off; last: where the move begins."""
    s = step.move.segment
    if s.kind == Kind.DWELL:
        module.lines.append(f'WaitTime {s.dwell:.3f};')
        if now and not after:
            module.bead(Step(step.move, last, None, 0.0, 0.0, step.role), now, last=True)
        elif after and not now:
            module.start(last, s.speed if s.speed > 0 else after[0], after)
    elif now:
        module.bead(step, now, last=not after)
    elif after:
        module.start(step.end, s.speed, after)
    else:
        module.move(step.end, s.speed)


def _main(name: str, calls: list[Call], cell: RobotCell) -> str:
    x, y, z = (v * 1e3 for v in (cell.origin if cell.axes else (0.0, 0.0, 0.0)))
    frames = f'[[0,0,0],[1,0,0,0]],[[{x:.4f},{y:.4f},{z:.4f}],[1,0,0,0]]'
    unit = f'FALSE,"{cell.abb.unit}"' if cell.axes else 'TRUE,""'
    lines = [f'ActUnit {cell.abb.unit};'] if cell.axes else []
    lines += ['ConfL\\Off;', 'PDispOff;']
    shift = 0.0
    for part, lift in calls:
        if lift != shift:
            lines.append(f'PDispSet [[0,0,{lift * 1e3:.4f}],[1,0,0,0]];')
            shift = lift
        lines.append(f'{part};')
    lines.append('PDispOff;')
    body = [f'  PERS wobjdata wobjWaam:=[FALSE,{unit},{frames}];', f'  PROC {name}()']
    body += [*(f'    {line}' for line in lines), '  ENDPROC']
    return '\n'.join([f'MODULE m{name}', *body, 'ENDMODULE', ''])
