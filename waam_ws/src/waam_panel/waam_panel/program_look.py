"""What is in a program before it runs: its layers and beads, and everything that is wrong with it, by line. No ROS.

Runs in the child process of `worker`, because a large program takes seconds. It asks the same functions as the job.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from waam_plan.import_gcode.dialect import DialectError
from waam_plan.import_gcode.files import load_program
from waam_plan.import_gcode.layers import Bead, Layer, layers_of, moved
from waam_plan.import_gcode.motion import Motion, Program
from waam_plan.import_gcode.place import part_offset, path_box
from waam_plan.import_gcode.plan_of import plan_program
from waam_plan.import_gcode.regime import regime_problems
from waam_plan.import_gcode.words import ProgramError
from waam_plan.mesh.part import PartError, load_part
from waam_plan.mesh.surface import top_surface
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.materials import get
from waam_process.operating import DEFAULT_MATERIAL
from waam_process.segment import Point

DRAWN = 0.05e-3  # m that a drawn curve may lie off
POINTS = 20_000  # of one layer; more are thinned out
ENDLESS = ((-math.inf,) * 3, (math.inf,) * 3)


@dataclass(frozen=True)
class Asked:
    """A program and how it is meant. shift, limits: m; limits in the work frame, endless while they are not known."""

    program: Path
    dialect: str = ''
    nominal: Path | None = None
    material: str = DEFAULT_MATERIAL
    shift: Point = (0.0, 0.0, 0.0)
    limits: tuple[Point, Point] = ENDLESS


@dataclass
class Check:
    """One question about the program. level: good, warning, bad, open (a check before it failed). line: 0 = none."""

    name: str
    level: str
    text: str
    line: int = 0


@dataclass
class Look:
    """checks in the order in which they were made; layers without points; beads[i]: those of layer i, mm."""

    checks: list[Check] = field(default_factory=list)
    layers: list[dict[str, Any]] = field(default_factory=list)
    beads: list[list[dict[str, Any]]] = field(default_factory=list)
    box: list[float] = field(
        default_factory=list
    )  # mm: lowest x, y, highest x, y of the path with the arc on
    totals: dict[str, float] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Nothing stands against a start."""
        return not any(c.level in ('bad', 'open') for c in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {'good': self.good}


NAMES = {
    'words': 'words and arc states',
    'layers': 'layers and beads',
    'process': 'speed, wire, voltage of the material',
    'reach': 'reach and soft limits',
    'metal': 'metal: ground, idle moves',
}
_REFUSED = (ProgramError, DialectError, PartError, ValueError, OSError)


def look(asked: Asked) -> Look:
    """Every check that can be made. Never raises for what is wrong with program, dialect or nominal part."""
    out = Look()
    program = _check(out, 'words', lambda: _read(asked))
    layers = program and _check(out, 'layers', lambda: layers_of(program))
    if program is None or layers is None:
        for name in list(NAMES)[len(out.checks) :]:
            out.checks.append(Check(NAMES[name], 'open', 'not looked at: see above'))
        return out
    _put_layers(out, program, layers)
    out.checks += _process(program, asked.material)
    out.checks.append(_reach(program, asked.limits))
    plan = _check(out, 'metal', lambda: _plan(program, asked))
    if plan is not None:
        _put_plan(out, plan)
    return out


def _check(out: Look, name: str, do: Callable[[], Any]) -> Any:
    """The result, or None; either way an entry of the list."""
    try:
        found = do()
    except _REFUSED as e:
        text = str(e)
        out.checks.append(Check(NAMES[name], 'bad', text, line_of(text)))
        return None
    out.checks.append(Check(NAMES[name], 'good', 'in order'))
    return found


def line_of(text: str) -> int:
    """The first line of the program that a refusal names; 0 = none."""
    found = re.search(r'\bline (\d+)', text)
    return int(found[1]) if found else 0


def _read(asked: Asked) -> Program:
    return moved(load_program(asked.program, asked.dialect), asked.shift)


def _process(program: Program, material: str) -> list[Check]:
    problems = regime_problems(program, get(material))
    name = NAMES['process']
    return [Check(name, 'bad', p, line_of(p)) for p in problems] or [
        Check(name, 'good', 'in order')
    ]


# ---- reach -----------------------------------------------------------------------------------


def _reach(program: Program, limits: tuple[Point, Point]) -> Check:
    """Bad where the program is larger than the machine, whatever its zero; a warning where it leaves the machine with
    the present zero, because a job sets its own."""
    name = NAMES['reach']
    if not all(map(math.isfinite, (*limits[0], *limits[1]))):
        return Check(name, 'warning', 'the machine has not said yet how far it reaches')
    moves = [m for m in program.motions if not m.dwell]
    ends = [m.corners(DRAWN) for m in moves]
    first = np.repeat(np.arange(len(moves)), [len(e) for e in ends])
    points = np.vstack(ends)
    for axis, letter in enumerate('XYZ'):
        value = points[:, axis]
        low, high = limits[0][axis], limits[1][axis]
        extent = float(np.nanmax(value) - np.nanmin(value))
        out = np.flatnonzero((value < low - 1e-9) | (value > high + 1e-9))
        if extent > high - low:
            line = moves[first[int(np.nanargmax(value))]].line
            return Check(name, 'bad', f'line {line}, {letter}: the program is {extent * 1e3:.1f} mm long, '
                         f'the machine {(high - low) * 1e3:.1f} mm', line)  # fmt: skip
        if out.size:
            line = moves[first[out[0]]].line
            return Check(name, 'warning', f'line {line}, {letter}{value[out[0]] * 1e3:.1f}: outside '
                         f'{low * 1e3:.1f} .. {high * 1e3:.1f} mm with the present work zero; the job asks again '
                         'with its own', line)  # fmt: skip
    return Check(name, 'good', 'inside the machine with the present work zero')


# ---- plan ------------------------------------------------------------------------------------


def _plan(program: Program, asked: Asked) -> Plan:
    """As the job plans it on a plate."""
    m = get(asked.material)
    settings = PlanSettings(
        layer_height=m.layer_height, bead_width=m.bead_width, speed=m.speed, pitch_ratio=m.overlap,
        wire_diameter=m.wire_diameter, efficiency=m.efficiency, voltage=m.voltage,
        arc_efficiency=m.arc_efficiency, machine_min=(-10.0,) * 3, machine_max=(10.0,) * 3,
    )  # fmt: skip
    (x0, y0, _), (x1, y1, _) = box = path_box(program)
    margin = 2 * settings.bead_width
    spec = GridSpec.covering(x0 - margin, y0 - margin, x1 + margin, y1 + margin, settings.grid)
    nominal = None
    if asked.nominal:
        part = load_part(asked.nominal, 1e-3, False)
        nominal = top_surface(part.mesh, spec, part_offset(part.bounds, box)[0])
    return plan_program(program, settings, HeightGrid.full(spec, 0.0), nominal)


def _put_plan(out: Look, plan: Plan) -> None:
    out.checks += [Check('nominal part', 'warning', w) for w in plan.warnings]
    out.checks += [Check('left out', 'warning', r) for r in plan.remarks[1:]]
    metal = sum(layer.volume for layer in plan.layers)
    out.totals |= {
        'arc_time_s': round(sum(layer.arc_time for layer in plan.layers), 1),
        'metal_mm3': round(metal * 1e9, 1),
        'wire_m': round(plan.wire, 2),
    }


# ---- pictures --------------------------------------------------------------------------------


def _put_layers(out: Look, program: Program, layers: list[Layer]) -> None:
    low, high = path_box(program) * 1e3
    out.box = [round(float(v), 3) for v in (*low[:2], *high[:2])]
    for layer in layers:
        beads = [_bead(b) for b in layer.beads]
        _thin(beads)
        out.beads.append(beads)
        out.layers.append(
            {
                'number': layer.number,
                'z_mm': round(layer.z * 1e3, 3),
                'beads': len(beads),
                'line': layer.beads[0].line,
                'length_mm': round(sum(b['length_mm'] for b in beads), 1),
            }
        )
    out.totals = {'layers': len(layers), 'beads': sum(len(b) for b in out.beads)}


def _bead(bead: Bead) -> dict[str, Any]:
    """Path with the arc on and the way to it, from above, mm."""
    moves = [m for m in bead.motions if not m.dwell]
    return {
        'line': bead.line,
        'last_line': moves[-1].line,
        'length_mm': round(sum(m.length for m in moves) * 1e3, 2),
        'speed_mm_s': round(moves[0].speed * 1e3, 2),
        'path': _path(moves),
        'way': _path([m for m in bead.way if not m.dwell]),
    }


def _path(moves: list[Motion]) -> list[list[float]]:
    """(n, 2) corners; pieces from or to an unknown place are left out."""
    if not moves:
        return []
    points = np.vstack([m.corners(DRAWN)[:, :2] for m in moves]) * 1e3
    points = points[np.isfinite(points).all(axis=1)]
    same = np.zeros(len(points), bool)
    same[1:] = (np.diff(points, axis=0) == 0).all(axis=1)
    return np.round(points[~same], 3).tolist()


def _thin(beads: list[dict[str, Any]]) -> None:
    """At most POINTS of a layer; both ends of every path stay."""
    step = -(-sum(len(b['path']) for b in beads) // POINTS)
    for b in beads if step > 1 else ():
        b['path'] = [*b['path'][:-1:step], b['path'][-1]]
