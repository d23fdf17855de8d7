"""Programs of others on the command line: their options, and `waam plan program.gcode`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the planner is loaded only when a verb needs it
    from .plan import Plan
    from .settings import PlanSettings

PART_HELP = 'nominal part (STL, PLY, 3MF, OBJ, OFF), or a program (G-code) that is laid as it is'


def add_program(p: argparse.ArgumentParser) -> None:
    """Options that belong to a program."""
    p.add_argument(
        '--nominal', type=Path, help='of a program: the part that it makes; closes the loop'
    )
    p.add_argument(
        '--dialect',
        default='',
        metavar='NAME',
        help='of a program: which codes light the arc, set wire, voltage and gas: waam (default), slicer, welder or '
        'a YAML file (waam_plan/README.md)',
    )
    p.add_argument(
        '--shift',
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=('X', 'Y', 'Z'),
        help='of a program: mm, added to its coordinates',
    )


def is_program(args: argparse.Namespace) -> bool:
    """Whether PART is G-code. ValueError for options that belong to a program when it is none."""
    from .import_gcode.files import is_program

    if is_program(args.part):
        return True
    if args.nominal or args.dialect or any(args.shift):
        raise ValueError(
            f'--nominal, --dialect and --shift belong to a program, not to {args.part}'
        )
    return False


def program_plan(args: argparse.Namespace, settings: PlanSettings) -> Plan:
    """The program as layers and beads, checked like a plan. Raises ValueError with a text for the user."""
    from waam_process.grid import GridSpec, HeightGrid

    from .agreement import check
    from .import_gcode.files import load_program
    from .import_gcode.layers import moved
    from .import_gcode.place import part_offset, path_box
    from .import_gcode.plan_of import plan_program
    from .mesh.part import load_part
    from .mesh.surface import top_surface

    x, y, z = args.shift
    program = moved(load_program(args.part, args.dialect), (x * 1e-3, y * 1e-3, z * 1e-3))
    (x0, y0, _), (x1, y1, _) = box = path_box(program)
    margin = 2 * settings.bead_width
    spec = GridSpec.covering(x0 - margin, y0 - margin, x1 + margin, y1 + margin, settings.grid)
    nominal, offset = None, (0.0, 0.0, 0.0)
    if args.nominal:
        part = load_part(args.nominal, args.scale, False, repair=args.repair)
        offset, how = part_offset(part.bounds, box)
        nominal = top_surface(part.mesh, spec, offset)
        print(how)
        for note in part.report.notes:
            print(f'{args.nominal.name}: {note}')
    found = HeightGrid.full(spec, 0.0)
    if args.as_found:
        found = top_surface(load_part(args.as_found, args.scale, False).mesh, spec, offset)
        if nominal is not None:
            check(found, nominal, settings, bottom=0.0)
    mode = args.mode or ('restore' if args.as_found else 'build')
    return plan_program(program, settings, found, nominal, layers=args.layers, mode=mode)
