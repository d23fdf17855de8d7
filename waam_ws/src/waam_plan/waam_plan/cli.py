"""waam plan: a part becomes a program, without any machine."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_process.operating import GANTRY, MACHINES, ROBOT

from . import cli_correct, cli_files, cli_program, cli_robot, cli_shaft
from .settings import ALTERNATIONS, FINISHES, STRATEGIES

if TYPE_CHECKING:  # the planner is loaded only when a verb needs it
    from .mesh.inputs import Surfaces
    from .mesh.part import Part
    from .plan import Plan
    from .settings import PlanSettings

SCALE = 1e-3  # m per unit of the files
EXAMPLES = """\
examples:
  waam plan roller.stl --as-found worn_roller.stl        fill what is worn off; both files in the same coordinates
  waam plan roller.stl --as-found scan.pcd --zone        the scan (PCD, PLY, XYZ, NPY) shows the worn zone only
  waam plan scan.pcd                                     no part: bring the scanned zone flat (--level)
  waam plan bracket.3mf --mode build --layers 5          the first five layers of a solid on a flat substrate
  waam plan bracket.stl --strategy combined --levels adaptive
  waam plan vase.stl --mode build --strategy shell       one bead along the surface; open meshes are accepted
  waam plan vase.stl --repair                            close its holes first; what was changed is printed
  waam plan part.stl --mode build --scale 1              a file in metres (default 0.001: mm)
  waam plan part.gcode --dialect slicer --nominal part.stl --preview   another slicer's program: layers, beads, checks
  waam plan part.stl --mode build --machine robot       what the robot will make of it: speeds, contacts, reach
  waam plan arm.stl --as-found post.stl --machine robot --tilt 80 --clamp   an overhang of 80 deg, the part tilted
  waam plan ring.stl --mode build --post kuka --positioner turn --out out/   a program for a robot with a positioner

--set of what a program without the closed loop needs:
  bead_time=60         wait when a bead took less than so many seconds (a job waits for the temperature instead)
  lead_on=0.5 lead_off=0.003 lead_in_metal=0.9           light before moving, put out before the end, less in the hump
  edge_metal=1.25      machining allowance along the edges
  alternation=turn turn_deg=67                           by --alternation turn: every layer at another angle

--set of rules for builds (docs/planning.md): compensation_height=0.012, shrinkage=0.008

Written to --out: program.gcode (runs on the controller without correction), segments.csv, plan.npz, preview.png,
preview.html (3-D, one file: open it in a browser).
"""


def epilog() -> str:
    """Strategies and examples for --help."""
    from waam_plan.fill.strategies import REGISTRY

    lines = [f'  {name:9s} {entry.summary}' for name, entry in REGISTRY.items()]
    return '\n'.join(['strategies (--strategy):', *lines, '', EXAMPLES])


class _Help(argparse.Action):
    """--help; loads the table of strategies only when it is printed."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, help='show this help and exit')

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        parser.epilog = epilog()
        parser.print_help()
        parser.exit()


def register(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    check_robot: Callable[[Plan, Path | None, bool, Path | None, list[Path]], None] | None = None,
    cell_reach: Callable[[str, bool], tuple[dict[str, Any], str]] | None = None,
) -> None:
    # check_robot(plan, urdf, turning, out, params_files): of --machine robot, prints, raises ValueError
    # cell_reach(cell or '', build): settings by the cell file and its name, ({}, '') without one; raises ValueError
    """Adds the verbs to argparse sub-parsers."""
    cli_correct.register(commands)
    p = commands.add_parser(
        'plan',
        help='a part becomes layers, beads and a program; no machine needed',
        description='Plan the deposition of a part and write program, maps and a picture.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
        add_help=False,
    )
    p.add_argument('-h', '--help', action=_Help, dest=argparse.SUPPRESS)
    _add_inputs(p)
    _add_layers(p)
    _add_outputs(p)
    p.set_defaults(
        run_command=run,
        check_robot=check_robot,
        cell_reach=cell_reach,
    )


def _add_inputs(p: argparse.ArgumentParser) -> None:
    """Options for the surface as found and the wanted part."""
    p.add_argument(
        'part',
        type=Path,
        metavar='PART',
        help='mesh (STL, PLY, 3MF, OBJ, OFF), cloud (PCD, PLY, XYZ, NPY) or a program (G-code) to look at and to check',
    )
    cli_program.add_program(p)
    cli_shaft.add_shaft(p)
    p.add_argument(
        '--mode', choices=('build', 'restore'), help='default: restore with --as-found, else build'
    )
    p.add_argument(
        '--as-found',
        type=Path,
        metavar='WORN',
        help='mesh, cloud or .npz height map of the worn surface',
    )
    p.add_argument(
        '--zone',
        action='store_true',
        help='the scan shows the worn zone only; nothing beside it is planned',
    )
    p.add_argument(
        '--level',
        type=float,
        metavar='MM',
        help='wanted height of a zone without a part; default: top + a layer',
    )
    p.add_argument(
        '--repair',
        action='store_true',
        help='close holes, remove double faces, turn normals outwards',
    )
    p.add_argument(
        '--scale', type=float, default=SCALE, help='m per unit of the files, default 0.001 (mm)'
    )


def _add_layers(p: argparse.ArgumentParser) -> None:
    """Options for how the metal is laid."""
    p.add_argument(
        '--layers', type=int, default=0, help='at most so many, from the bottom; 0 = all'
    )
    p.add_argument('--layer-height', type=float, metavar='MM', help='default 2')
    p.add_argument('--bead-width', type=float, metavar='MM', help='default 6')
    p.add_argument('--speed', type=float, metavar='MM/S', help='travel with the arc on, default 10')
    p.add_argument(
        '--direction', choices=('auto', 'x', 'y'), help='of the beads; auto = along the longer side'
    )
    p.add_argument('--alternation', choices=ALTERNATIONS, help='from layer to layer')
    p.add_argument('--strategy', choices=STRATEGIES, help='how layers are filled, see below')
    p.add_argument(
        '--finish',
        choices=FINISHES,
        help='of a restoration; machined: nothing below nominal after machining, with the allowance for it (its own '
        'choice, or --set allowance=M)',
    )
    p.add_argument(
        '--levels', choices=('equal', 'adaptive'), help='heights of the layers of a build'
    )
    p.add_argument(
        '--overhang', type=float, metavar='DEG', help='steepest overhang of a build, default 45'
    )
    p.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='any field of PlanSettings, SI',
    )


def _add_outputs(p: argparse.ArgumentParser) -> None:
    """Options for the files that are written."""
    p.add_argument(
        '--out', type=Path, metavar='DIR', help='folder for the files; none are written without it'
    )
    p.add_argument(
        '--post',
        choices=('gcode', 'gcode-compact', *cli_robot.POSTS),
        default='gcode',
        help='gcode-compact: also compact.gcode, long lines and arcs (G2, G3) instead of chords; fanuc (.LS), kuka '
        '(.src, .dat), abb (.mod): also a program for a robot, fragments with a main program (arcs, equal layers once)',
    )
    p.add_argument(
        '--machine',
        choices=MACHINES,
        default=GANTRY,
        help='robot: also look where the robot of `waam up --machine robot` cannot hold the programmed speed, what '
        'comes too near to what and what is out of reach; exit status 2 where the plan cannot be run',
    )
    cli_robot.add_robot(p)
    p.add_argument(
        '--tolerance',
        type=float,
        metavar='MM',
        help='of compact programs, default 0.02, of robots 0.004; with 0.02 chords of 2 mm become arcs where their '
        'radius is above 25 mm, with 0.05 above 10 mm',
    )
    p.add_argument(
        '--part-tolerance',
        type=float,
        metavar='MM',
        help='allowed deviation of a restored surface: decides how thick the finishing layers are '
        '(default: all layers alike)',
    )
    p.add_argument(
        '--preview',
        '--view',
        dest='preview',
        action='store_true',
        help='draw preview.png and preview.html (into --out or the current folder)',
    )


def run(args: argparse.Namespace) -> int:
    """Plans, prints a table, writes the files. 0, or 2 with one line of error."""
    try:
        plan = make_plan(args)
        cli_files.write(plan, args)
        if args.machine == ROBOT:
            _check_robot(plan, args)
        if told := _forecast(args):
            print(f'what will come out of it: {told}')
    except (ValueError, OSError) as error:
        print(f'waam plan: {error}', file=sys.stderr)
        return 2
    return 0


def _forecast(args: argparse.Namespace) -> str:
    """The command that foretells the job; '' where the laboratory cannot lay it: programs need more to be said, and of
    a worn zone or a cloud alone nobody knows the part."""
    from waam_plan.mesh.clouds import is_cloud

    worn = args.as_found
    if args.shaft:
        return cli_shaft.forecast(args)
    alone = is_cloud(args.part) or args.zone or (worn is not None and worn.suffix == '.npz')
    if alone or cli_program.is_program(args):
        return ''
    words = ['waam', 'forecast', str(args.part)]
    names = 'as_found', 'mode', 'finish', 'strategy', 'layer_height', 'bead_width', 'layers', 'out'
    for name in names:
        if value := getattr(args, name):
            words += [f'--{name.replace("_", "-")}', str(value)]
    if args.scale != SCALE:
        words += ['--scale', f'{args.scale:g}']
    if args.repair:
        words.append('--repair')
    if args.machine == ROBOT:
        words += ['--machine', ROBOT, *(('--urdf', str(args.urdf)) if args.urdf else ())]
    elif args.cell:
        words += ['--cell', args.cell]
    if args.part_tolerance is not None:
        words += ['--tolerance', f'{args.part_tolerance:g}']
    own = {
        'speed': args.speed and args.speed * 1e-3, 'direction': args.direction, 'alternation': args.alternation,
        'levels': args.levels, 'overhang_limit_deg': args.overhang, 'tilt_deg': args.tilt, 'clamp': args.clamp,
    }  # fmt: skip
    for text in (*(f'{k}={v}' for k, v in own.items() if v), *args.set):
        name, _, value = text.partition('=')
        if name in (
            'allowance',
            'tolerance',
            'layer_height',
            'bead_width',
        ):  # options of their own, in mm
            words += [f'--{name.replace("_", "-")}', f'{float(value) * 1e3:g}']
        elif name == 'strategy':
            words += ['--strategy', value]
        elif name not in ('machine_min', 'machine_max', 'grid'):  # those of the simulated machine
            words += ['--set', f'plan.{text}']
    return shlex.join(words)


def _check_robot(plan: Plan, args: argparse.Namespace) -> None:
    if args.check_robot is None:
        raise ValueError('--machine robot needs the robot bridge: call it as `waam plan`')
    args.check_robot(plan, args.urdf, args.turning, args.out, args.params_file)
    if args.turning and args.post in cli_robot.POSTS and not args.robot_cell:
        print(
            'warning: the program does not turn the part: write it again with --robot-cell and this cell.yaml'
        )


def make_plan(args: argparse.Namespace) -> Plan:
    """The plan that the arguments ask for. Raises ValueError with a text for the user."""
    from waam_plan.layers.build import plan_build
    from waam_plan.mesh.clouds import is_cloud
    from waam_plan.mesh.part import load_part

    settings = settings_from(args)
    cli_robot.check_arm(args)
    if settings.tilt_deg:
        cli_robot.check_tilt(args, settings)
    if settings.unrolled:
        return cli_shaft.plan(args, settings)
    if cli_program.is_program(args):
        return cli_program.program_plan(args, settings)
    if is_cloud(args.part):
        return _flat(args, settings)
    if args.level is not None:
        raise ValueError('--level belongs to a cloud without a part')
    mode = args.mode or ('restore' if args.as_found else 'build')
    if mode == 'restore' and not args.as_found:
        raise ValueError(
            '--mode restore needs --as-found: the worn surface as a mesh, a cloud or a .npz height map'
        )
    if mode == 'build' and args.as_found:
        raise ValueError('--as-found belongs to --mode restore, a build starts on a flat substrate')
    open_is_fine = mode == 'restore' or settings.strategy == 'shell'
    part = load_part(
        args.part, args.scale, not open_is_fine, repair=args.repair, look_for_crossings=True
    )
    for line in part.report.lines():
        print(line)
    if told := cli_shaft.lying(part, args):
        print(f'warning: {told}')
    if mode == 'build':
        part = part.tilted(settings.tilt_deg)
        return plan_build(part, settings, args.layers)
    return _restoration(part, args, settings)


def _restoration(part: Part, args: argparse.Namespace, settings: PlanSettings) -> Plan:
    from waam_plan.mesh.part import check_fits
    from waam_plan.mesh.placed import surfaces_of

    check_fits(part.tilted(settings.tilt_deg), settings)
    surfaces = surfaces_of(part, args.as_found, args.scale, settings, args.zone)
    return _restored(surfaces, args, settings)


def _flat(args: argparse.Namespace, settings: PlanSettings) -> Plan:
    """A scanned zone without a part."""
    from waam_plan.mesh.clouds import read_cloud
    from waam_plan.mesh.inputs import flat

    if args.as_found or args.mode == 'build':
        raise ValueError(f'{args.part} is a cloud: give the part first, the cloud as --as-found')
    level = None if args.level is None else args.level * 1e-3
    return _restored(flat(read_cloud(args.part, args.scale), settings, level), args, settings)


def _restored(surfaces: Surfaces, args: argparse.Namespace, settings: PlanSettings) -> Plan:
    from dataclasses import replace

    from waam_plan.layers.restore import plan_restoration

    plan = plan_restoration(surfaces.found, surfaces.nominal, settings, args.layers)
    remarks = [*surfaces.notes, *plan.remarks]
    return replace(plan, name=args.part.stem, offset=surfaces.offset, remarks=remarks)


def settings_from(args: argparse.Namespace) -> PlanSettings:
    """PlanSettings from the options; mm and mm/s become SI here."""
    from waam_plan.finish import bead_width
    from waam_plan.settings import PlanSettings, assigned

    given: dict[str, Any] = {}
    for name, factor in (('layer_height', 1e-3), ('bead_width', 1e-3), ('speed', 1e-3)):
        if getattr(args, name) is not None:
            given[name] = getattr(args, name) * factor
    if args.part_tolerance is not None:
        given['tolerance'] = args.part_tolerance * 1e-3
    if args.overhang is not None:
        given['overhang_limit_deg'] = args.overhang
    if args.tilt is not None:
        given['tilt_deg'] = args.tilt
    if args.clamp:
        given['clamp'] = True
    given |= {
        k: getattr(args, k)
        for k in ('direction', 'alternation', 'strategy', 'levels', 'finish')
        if getattr(args, k)
    }
    given |= cli_shaft.settings_of(args) | assigned(args.set)
    usual = {'bead_width': bead_width(PlanSettings.bead_width, str(given.get('finish', '')))}
    settings = PlanSettings(**cli_robot.box(args) | _of_cell(args) | usual | given)
    if args.machine == GANTRY and 'machine_max' not in given:
        print(_reach(settings, args))
    return settings


def _of_cell(args: argparse.Namespace) -> dict[str, Any]:
    """Settings by the cell file of a gantry; keeps its name in args.reach_of."""
    args.reach_of = ''
    if args.cell_reach is None or args.machine != GANTRY:
        return {}
    from waam_plan.mesh.clouds import is_cloud

    restores = args.mode == 'restore' or (args.mode is None and bool(args.as_found))
    found, args.reach_of = args.cell_reach(
        args.cell or '', not restores and not is_cloud(args.part)
    )
    return found


def _reach(settings: PlanSettings, args: argparse.Namespace) -> str:
    """The machine that the plan is for, and who says so."""
    pairs = zip(settings.machine_min, settings.machine_max, strict=True)
    size = ' x '.join(f'{(high - low) * 1e3:g}' for low, high in pairs)
    zero = ', '.join(f'{-v * 1e3:g}' for v in settings.machine_min)
    who = args.reach_of or 'assumed, there is no cell file (waam cell new)'
    return f'machine: {size} mm, work zero at {zero} mm: {who}'
