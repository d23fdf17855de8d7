"""waam correct: a program for axes that are not square or not to scale."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .gcode.skew import AxisErrors

EPILOG = """\
examples:
  waam correct program.gcode --y-to-x 0.12 --out straight.gcode           y axis leans 0.12 deg towards +x
  waam correct program.gcode --diagonals 200 150 250.4 249.6 --out s.gcode  from a measured rectangle: sides, diagonals
  waam correct program.gcode --scale-x 1.0021 --out s.gcode               100 mm commanded, 100.21 mm measured

The zero of the calibration is the work zero. Until a line has named X, Y and Z, a rapid (G0) moves only the axes it
names: the first `G0 Z16` of a program lifts, the `G0 X Y` that follows puts the torch right. So begin with Z where it
leans, as the programs of `waam plan` do; everything else before the place is known is refused, with its line.
Arcs (G2, G3) become lines within 0.002 mm of their image, for on leaning axes that is an ellipse.
"""


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the verb to argparse sub-parsers."""
    p = commands.add_parser(
        'correct',
        help='bend a G-code program against skew and scale errors of the machine',
        description='Correct a program for axes that are not square or not to scale (see docs/equations.md, S2).',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        'program',
        type=Path,
        metavar='PROGRAM',
        help='G-code; begins with G0 Z, then G0 X Y',
    )
    for name, text in (
        ('y-to-x', 'the y axis leans towards +x (alpha)'),
        ('x-to-y', 'the x axis leans towards +y (beta)'),
        ('z-to-x', 'the z axis leans towards +x'),
        ('z-to-y', 'the z axis leans towards +y'),
    ):
        p.add_argument(f'--{name}', type=float, default=0.0, metavar='DEG', help=text)
    for axis in 'xyz':
        p.add_argument(
            f'--scale-{axis}',
            type=float,
            default=1.0,
            metavar='K',
            help=f'measured over commanded length along {axis}',
        )
    p.add_argument(
        '--diagonals',
        type=float,
        nargs=4,
        metavar=('SIDE_X', 'SIDE_Y', 'RISING', 'FALLING'),
        help='measured rectangle instead of --y-to-x; RISING goes from its corner nearest to zero',
    )
    p.add_argument('--out', type=Path, required=True, metavar='FILE', help='corrected program')
    p.set_defaults(run_command=run)


def run(args: argparse.Namespace) -> int:
    """0, or 2 with one line of error."""
    from .gcode import skew_program

    try:
        errors = errors_from(args)
        text = args.program.read_text()
        args.out.write_text(skew_program.correct_gcode(text, errors.correction))
    except (ValueError, OSError) as e:
        print(f'waam correct: {e}', file=sys.stderr)
        return 2
    print(f'written: {args.out}')
    return 0


def errors_from(args: argparse.Namespace) -> AxisErrors:
    """AxisErrors from the options. Raises SkewError."""
    from .gcode import skew

    angle = math.radians(args.y_to_x)
    if args.diagonals:
        if args.y_to_x:
            raise skew.SkewError('--diagonals and --y-to-x say the same; give one')
        angle = skew.angles_from_diagonals(*args.diagonals)
    return skew.AxisErrors(
        y_to_x=angle,
        x_to_y=math.radians(args.x_to_y),
        z_to_x=math.radians(args.z_to_x),
        z_to_y=math.radians(args.z_to_y),
        scale_x=args.scale_x,
        scale_y=args.scale_y,
        scale_z=args.scale_z,
    )
