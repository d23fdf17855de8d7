"""Programs for a KUKA controller: KRL modules (.src, .dat) called from a main program.

Arc, wire and gas are the commands of KUKA.ArcTech: ARCON at the start of a bead, ARCSWI where its setpoints change,
ARCOFF at its end, each with a record stArcDat_T (gas before and after, travel speed, channels of the welding device).
A record counts from the end of its move on. Equal layers are one module, called with a lifted base. With a positioner
E1 tilts and E2 turns, and the base moves with it (EK).
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
from waam_process.segment import Kind

CHANNELS = 8
VERSION = 303030366  # of the records of ArcTech


def write_krl(
    plan: Plan, name: str = 'WAAM', cell: RobotCell | None = None, tolerance: float = TOLERANCE
) -> dict[str, str]:
    """File name -> text: `<name>.src` and, for every fragment, .src and .dat. RobotProgramError for a name that is none
    and beyond the limits of the controller."""
    cell = cell or RobotCell()
    found = programs(plan, name, tolerance, lambda part, moves: _module(part, moves, cell))
    files = {f'{name}.src': _main(name, found.calls, cell)}
    for part, (source, data) in found.texts.items():
        files |= {f'{part}.src': source, f'{part}.dat': data}
    return files


@dataclass
class _Module:
    name: str
    cell: RobotCell
    source: list[str] = field(default_factory=list)
    data: list[str] = field(default_factory=list)
    points: int = 0
    records: int = 0
    speed: str = ''
    blend: str = ''

    def point(self, pose: Pose) -> str:
        self.points += 1
        x, y, z = (f'{v * 1e3:.4f}' for v in pose.place)
        c, b, a = (f'{math.degrees(v):.4f}' for v in pose.wpr)  # A about z, B about y, C about x
        e1, e2 = (f'{math.degrees(v):.4f}' for v in pose.external or (0.0, 0.0))
        self.data.append(
            f'DECL E6POS XP{self.points}={{X {x},Y {y},Z {z},A {a},B {b},C {c},E1 {e1},E2 {e2},'
            'E3 0.0,E4 0.0,E5 0.0,E6 0.0}'
        )
        return f'XP{self.points}'

    def record(self, strike: bool, weld: Setpoints | None) -> str:
        """A record: with Strike at the start of a bead, with Crater (weld None) at its end."""
        self.records += 1
        name = f'WDAT{self.records}'
        parts = [f'WdatId[] "{name}"', f'Info {{Version {VERSION}}}']
        if strike and weld:
            parts.append(
                'Strike {JobModeId[] "Job mode",ParamSetId[] "Set1",StartTime 0.0,'
                f'PreFlowTime {self.cell.pre_flow:.3f},{self._channels(weld)},PurgeTime 0.0}}'
            )
        if weld:
            parts.append(
                f'Weld {{JobModeId[] "Job mode",ParamSetId[] "Set2",Velocity {weld[0]:.6f},'
                f'{self._channels(weld)}}}'
            )
        else:
            parts.append(
                'Crater {JobModeId[] "Job mode",ParamSetId[] "Set3",CraterTime 0.0,'
                f'PostflowTime {self.cell.post_flow:.3f},{self._channels((0.0, 0.0, 0.0))},BurnBackTime 0.0}}'
            )
        self.data.append(f'DECL stArcDat_T {name}={{{",".join(parts)}}}')
        return name

    def _channels(self, weld: Setpoints) -> str:
        values = [0.0] * CHANNELS
        if self.cell.kuka.voltage_channel:
            values[self.cell.kuka.voltage_channel - 1] = weld[2]
        values[self.cell.kuka.feed_channel - 1] = weld[1]
        return ','.join(f'Channel{n} {v:.4f}' for n, v in enumerate(values, 1))

    def at_speed(self, text: str) -> None:
        if text != self.speed:
            self.source.append(f'$VEL.CP={text}')
            self.speed = text

    def move(self, end: Pose, via: Pose | None, zone: float) -> None:
        tail = ''
        if zone > 0:
            blend = f'{zone * 1e3:.2f}'
            if blend != self.blend:
                self.source.append(f'$APO.CDIS={blend}')
                self.blend = blend
            tail = ' C_DIS'
        if via:
            help_point = self.point(via)
            self.source.append(f'CIRC {help_point},{self.point(end)}{tail}')
        else:
            self.source.append(f'LIN {self.point(end)}{tail}')


def _module(name: str, moves: list[Move], cell: RobotCell) -> list[str]:
    """Source and data of one module. A bead: the move to its start is ARCON, its last one ARCOFF."""
    start, found = steps(moves, cell)
    weld = [*welds([s.move for s in found]), None]
    module = _Module(name, cell)
    last = start
    module.at_speed(f'{found[0].move.segment.speed:.6f}')
    if weld[0]:
        _arc_on(module, start, weld[0])
    else:
        module.move(start, None, 0.0)
    for n, step in enumerate(found):
        _step(module, step, weld[n], weld[n + 1], last)
        last = step.end
    point = f'DECL stArcDat_T WP={{WdatId[] "WP",Info {{Version {VERSION}}}}}'
    texts = [
        [f'DEF {name}()', *module.source, 'END', ''],
        [f'DEFDAT {name}', point, *module.data, 'ENDDAT', ''],
    ]  # fmt: skip
    return ['\n'.join(['&ACCESS RVP', '&REL 1', *lines]) for lines in texts]


def _step(
    module: _Module, step: Step, now: Setpoints | None, after: Setpoints | None, last: Pose
) -> None:
    """now, after: setpoints of this move and the next, None with the arc off; last: where the move begins."""
    s = step.move.segment
    dwells = s.kind == Kind.DWELL
    end, via, zone = (last, None, 0.0) if dwells else (step.end, step.via, step.zone)
    if dwells:
        module.source.append(f'WAIT SEC {s.dwell:.3f}')
    else:
        module.at_speed('gArcBasVelDefinition' if now else f'{s.speed:.6f}')
    if after and not now:
        _arc_on(module, end, after)
    elif now and not after:
        _arc_off(module, end, via)
    elif now and after and now != after:
        _switch(module, end, via, zone, after)
    elif not dwells:
        module.move(end, via, zone)


def _fold(module: _Module, kind: str, record: str, lines: list[str]) -> None:
    module.source += [f';FOLD {kind} {record}', *lines]


def _arc_on(module: _Module, end: Pose, weld: Setpoints) -> None:
    r = module.record(True, weld)
    _fold(module, 'ARCON', r, [
        f'TRIGGER WHEN DISTANCE=1 DELAY=ArcGetDelay(#PreDefinition,{r}) DO ArcMainNG(#PreDefinition,{r},WP) PRIO=-1',
        f'TRIGGER WHEN PATH=ArcGetPath(#OnTheFlyArcOn,{r}) DELAY=ArcGetDelay(#GasPreflow,{r}) DO '
        f'ArcMainNG(#GasPreflow,{r},WP) PRIO=-1',
        f'TRIGGER WHEN PATH=ArcGetPath(#OnTheFlyArcOn,{r}) DELAY=0 DO ArcMainNG(#ArcOnMoveStd,{r},WP) PRIO=-1',
        f'ArcMainNG(#ArcOnBeforeMoveStd,{r},WP)',
    ])  # fmt: skip
    module.move(end, None, 0.0)
    module.source += [f'ArcMainNG(#ArcOnAfterMoveStd,{r},WP)', ';ENDFOLD']


def _switch(module: _Module, end: Pose, via: Pose | None, zone: float, weld: Setpoints) -> None:
    r = module.record(False, weld)
    _fold(module, 'ARCSWI', r, [
        f'TRIGGER WHEN DISTANCE=1 DELAY=0 DO ArcMainNG(#ArcSwiMoveStd,{r},WP) PRIO=-1',
        f'ArcMainNG(#ArcSwiBeforeMoveStd,{r},WP)',
    ])  # fmt: skip
    module.move(end, via, zone)
    module.source += [f'ArcMainNG(#ArcSwiAfterMoveStd,{r},WP)', ';ENDFOLD']
    module.speed = ''  # the variable has another value from here on


def _arc_off(module: _Module, end: Pose, via: Pose | None) -> None:
    r = module.record(False, None)
    _fold(module, 'ARCOFF', r, [
        f'TRIGGER WHEN PATH=ArcGetPath(#ArcOffBefore,{r}) DELAY=0 DO ArcMainNG(#ArcOffBeforeOffStd,{r},WP) PRIO=-1',
        f'TRIGGER WHEN PATH=ArcGetPath(#OnTheFlyArcOff,{r}) DELAY=0 DO ArcMainNG(#ArcOffMoveStd,{r},WP) PRIO=-1',
        f'ArcMainNG(#ArcOffBeforeMoveStd,{r},WP)',
    ])  # fmt: skip
    module.move(end, via, 0.0)
    module.source += [f'ArcMainNG(#ArcOffAfterMoveStd,{r},WP)', ';ENDFOLD']


def _main(name: str, calls: list[Call], cell: RobotCell) -> str:
    lines = [
        '&ACCESS RVP', '&REL 1', f'DEF {name}()', 'BAS(#INITMOV,0)', f'$TOOL=TOOL_DATA[{cell.kuka.tool}]',
        '$IPO_MODE=#BASE', 'PTP $AXIS_ACT',
    ]  # fmt: skip
    shift = math.nan
    for part, lift in calls:
        if lift != shift:
            lines.append(_base(lift, cell))
            shift = lift
        lines.append(f'{part}()')
    return '\n'.join([*lines, 'END', ''])


def _base(lift: float, cell: RobotCell) -> str:
    """The base, lifted; with a positioner it lies on its faceplate and moves along."""
    x, y, z = (*(cell.origin[:2] if cell.axes else (0.0, 0.0)), cell.origin[2] * cell.axes + lift)
    frame = f'{{X {x * 1e3:.4f},Y {y * 1e3:.4f},Z {z * 1e3:.4f},A 0.0,B 0.0,C 0.0}}'
    if cell.axes:
        machine = f'MACHINE_DEF[{cell.kuka.machine}]'
        return f'$BASE=EK({machine}.ROOT,{machine}.MECH_TYPE,{frame})'
    return f'$BASE=BASE_DATA[{cell.kuka.base}]:{frame}'
