"""What the command line says of a shaft: `waam plan`, `waam lab`, `waam forecast`."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from waam_process.operating import GANTRY

if TYPE_CHECKING:  # the planner is loaded only when a verb needs it
    import argparse

    from .mesh.part import Part
    from .plan import Plan
    from .settings import PlanSettings

TOLERANCE = 0.2e-3  # m, as of a job, so that the plan is that of a job


def add_shaft(p: argparse.ArgumentParser) -> None:
    """Options of a shaft that turns."""
    p.add_argument(
        '--shaft',
        type=float,
        metavar='MM',
        help='PART is the scan of a worn shaft of this nominal diameter, which turns in a chuck in place of the X '
        'axis: a map of one turn (.npz) or a cloud around the axis y',
    )
    p.add_argument(
        '--ends',
        type=float,
        metavar='MM',
        help='with --shaft: so much of it is unworn at each end; its run-out is found there',
    )


def settings_of(args: argparse.Namespace) -> dict[str, Any]:
    """Settings of the planner, SI; {} without a shaft. ValueError for what does not go with one."""
    if getattr(args, 'shaft', None) is None:
        if getattr(args, 'ends', None) is not None:
            raise ValueError('--ends belongs to --shaft')
        return {}
    if args.ends is None:
        raise ValueError('--shaft needs --ends: how much of the shaft is unworn at each end, in mm')
    for name, value in (('--shaft', args.shaft), ('--ends', args.ends)):
        if not 0 < value < math.inf:
            raise ValueError(f'{name} {value:g}: a length in mm, above 0')
    if args.as_found is not None:
        raise ValueError(
            '--as-found does not go with --shaft: PART is the scan, the nominal shaft is a cylinder'
        )
    if args.mode == 'build':
        raise ValueError('--mode build does not go with --shaft: a shaft is restored')
    if getattr(args, 'post', 'gcode') not in ('gcode', 'gcode-compact'):
        raise ValueError(
            f'--post {args.post} not with --shaft: programs of robots that turn a shaft are not built'
        )
    if getattr(args, 'machine', GANTRY) != GANTRY:
        raise ValueError(
            "--shaft does not go with --machine robot: a positioner's turn axis for shafts is not built, only a chuck "
            'in place of the X axis of a gantry'
        )
    return {'shaft_diameter': args.shaft * 1e-3, 'shaft_ends': args.ends * 1e-3}


def plan(args: argparse.Namespace, settings: PlanSettings) -> Plan:
    """The plan of a worn shaft. Raises ValueError with a text for the user."""
    from waam_plan.layers.restore import plan_restoration
    from waam_plan.shaft.surfaces import of_file
    from waam_process.unrolled import LONGEST_AXIS

    if args.zone or args.level is not None or args.repair or args.nominal:
        raise ValueError('--zone, --level, --repair and --nominal do not go with --shaft')
    _, y1, z1 = settings.machine_max
    settings = replace(settings, machine_max=(settings.machine_min[0] + LONGEST_AXIS, y1, z1))
    if not settings.tolerance:
        settings = replace(settings, tolerance=TOLERANCE)
    found, nominal, run_out = of_file(args.part, args.scale, settings)
    made = plan_restoration(found, nominal, settings, args.layers)
    return replace(made, name=args.part.stem, remarks=[run_out.text, *made.remarks])


def lying(part: Part, args: argparse.Namespace) -> str:
    """For a part that is a lying body of revolution: what it is and how a shaft is planned; '' for others."""
    from waam_plan.shaft.revolution import body_of

    body = body_of(part.mesh)
    if body is None or abs(body.axis[2]) > 0.5:
        return ''
    axis = 'xyz'[int(abs(body.axis).argmax())]
    return (
        f'{part.path.name} is a body of revolution: its axis lies along {axis}, largest diameter '
        f'{body.diameter * 1e3:.1f} mm, length {body.length * 1e3:.1f} mm. It is planned as it lies, from above, on '
        'one side. A shaft that turns is planned from its scan: '
        + shlex.join(
            ['waam', 'plan', 'scan.npz', '--shaft', f'{body.diameter * 1e3:g}', '--ends', 'MM']
        )
    )


def forecast(args: argparse.Namespace) -> str:
    """The command that foretells what comes of the same shaft."""
    words = [
        'waam',
        'forecast',
        str(args.part),
        '--shaft',
        f'{args.shaft:g}',
        '--ends',
        f'{args.ends:g}',
    ]
    if args.finish:
        words += ['--finish', args.finish]
    if args.strategy:
        words += ['--strategy', args.strategy]
    if args.part_tolerance is not None:
        words += ['--tolerance', f'{args.part_tolerance:g}']
    if not math.isclose(args.scale, 1e-3):
        words += ['--scale', f'{args.scale:g}']
    return shlex.join(words)
