"""`waam calibrate`: measures, judges, keeps the result with its date, and tells the controller."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from . import cli_process, cli_robot
from .cli_common import folder, keep, verb

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    from .cli_common import Verbs
    from .graph import Graph

EPILOG = """\
examples:
  waam calibrate resonance --axis x                     shakes x, chooses the shaper, tells the controller
  waam calibrate resonance --axis y --point 200 150 100 --dry-run
  waam calibrate steps --axis x --commanded 50 150 250 --measured 49.98 149.91 249.87
  waam calibrate skew --side-x 200 --rising 283.1 --falling 282.6 --gauge 0.02
  waam calibrate tcp --width 0.10 0.12 0.11 --slope 30 --wire 1.2
  waam calibrate wire --counts-per-turn 4096 --length 500 500 500 --counted 18624 18619 18630 --controller 37.25
  waam calibrate lead --program steps.gcode             writes a bead with steps of speed
  waam calibrate lead --record jobs/latest              delay and lag of the wire drive, from that bead
  waam calibrate arc --samples relay.csv                gains of the arc regulator, from a relay experiment
  waam calibrate robot-tcp --file touches.csv           tip of a robot's tool, from touches of a fixed point
  waam calibrate hand-eye --file profiles.csv           scanner on a robot, from profiles of a sphere
  waam calibrate hand-eye --rehearse 3                  the same on a simulated robot
  waam calibrate status                                 what is calibrated, when, and what a job will refuse
  waam calibrate apply                                  tells a controller that lost its power what was found

Results lie in calibrations/ (or $WAAM_CALIBRATIONS), one YAML file with its hash and one report each. Poor evidence is
refused with the reason and exit status 2; then nothing is kept and nothing is told to the controller.
"""
RESONANCE = """\
The torch goes to the probe point. The axis is moved there and back by at most 2 mm, ever faster, from 1 Hz up, by moves
that the controller executes as those of any program; the arc stays off. An accelerometer on the moving axes listens.
For it the shaper of the axis is off and its acceleration that of the machine. The controller is told the shaper that is
taken and the acceleration that goes with it, at most that of the machine. Needs a graph that is up (waam up) with an
accelerometer; the simulated cell has one when its parameter gantry_on is true. The machine must be free to move by 2 mm
around the point.
"""


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser], graph: Graph) -> None:
    """Adds the verb to the waam command."""
    p = commands.add_parser(
        'calibrate',
        help='resonance, steps per mm, skew, tool centre point, wire, arc, robot; what is calibrated',
        description='Calibration of the machine. Every result is kept with its date and judged.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = p.add_subparsers(dest='calibrate_command', metavar='VERB', required=True)
    _add_resonance(verbs, graph)
    _add_lengths(verbs, graph)
    cli_process.register(verbs, graph)
    cli_robot.register(verbs, graph)
    status = verb(verbs, 'status', 'what is calibrated, when, and what a job will refuse', graph)
    graph.add_options(status)
    status.set_defaults(run_command=lambda args: show_status(args, graph))
    apply = verb(verbs, 'apply', 'tell the controller the settings of all results again', graph)
    graph.add_options(apply)
    apply.set_defaults(run_command=lambda args: send_all(args, graph))


def _add_resonance(verbs: Verbs, graph: Graph) -> None:
    p = verb(verbs, 'resonance', 'shake an axis, choose its input shaper and acceleration', graph)
    p.epilog = RESONANCE
    p.add_argument('--axis', choices=('x', 'y'), required=True)
    p.add_argument(
        '--point', nargs=3, type=float, metavar=('X', 'Y', 'Z'),
        help='probe point, work frame, mm (default: where the torch is)',
    )  # fmt: skip
    p.add_argument('--from-hz', type=float, default=1.0, metavar='HZ', help='default 1')
    p.add_argument('--to-hz', type=float, default=134.0, metavar='HZ', help='default 134')
    p.add_argument('--rate', type=float, default=2.0, metavar='HZ/S', help='Hz per second, 2')
    p.add_argument(
        '--samples', type=Path, metavar='FILE',
        help='samples of an earlier sweep (.npz beside its result) instead of a machine',
    )  # fmt: skip
    _add_controller(p, graph)
    p.set_defaults(run_command=lambda args: resonance(args, graph))


def _add_controller(p: argparse.ArgumentParser, graph: Graph) -> None:
    """Options of a verb that tells the controller its result."""
    p.add_argument(
        '--dry-run', action='store_true', help='tell the controller nothing and keep nothing'
    )
    graph.add_options(p)


def _add_lengths(verbs: Verbs, graph: Graph) -> None:
    p = verb(verbs, 'steps', 'steps per mm of an axis, from travels that were measured', graph)
    p.add_argument('--axis', choices=('x', 'y', 'z'), required=True)
    lengths = {
        'commanded': 'travels, mm, all in one direction',
        'measured': 'by gauge, mm, same order',
    }
    for name, text in lengths.items():
        p.add_argument(f'--{name}', nargs='+', type=float, required=True, metavar='MM', help=text)
    p.add_argument(
        '--steps-per-mm', type=float, metavar='N',
        help='of the controller when the travels were made (default: what it says now)',
    )  # fmt: skip
    _add_controller(p, graph)
    p.set_defaults(run_command=lambda args: steps(args, graph))
    p = verb(verbs, 'skew', 'angle between x and y, from a frame that was measured', graph)
    sides = {'side-x': 'along x', 'rising': 'diagonal from the origin', 'falling': 'the other one'}
    for name, text in sides.items():
        p.add_argument(f'--{name}', type=float, required=True, metavar='MM', help=text)
    p.add_argument('--side-y', type=float, metavar='MM', help='along y, to check the others')
    p.add_argument(
        '--gauge', type=float, default=0.05, metavar='MM', help='uncertainty of a length (0.05)'
    )
    p.set_defaults(run_command=lambda args: skew(args, graph))
    p = verb(verbs, 'tcp', 'tool centre point, from the steps of a bead on a flank', graph)
    p.add_argument('--width', nargs='+', type=float, required=True, metavar='MM', help='of a step')
    p.add_argument('--slope', type=float, required=True, metavar='DEG', help='of the flank')
    p.add_argument(
        '--wire', type=float, required=True, metavar='MM', help='diameter of wire or beam'
    )
    p.set_defaults(run_command=lambda args: tool_point(args, graph))


# ---- verbs


def resonance(args: argparse.Namespace, graph: Graph) -> int:
    """Shakes, judges, keeps, tells the controller. EvidenceError when the samples do not show a mode."""
    from . import outcome, pictures, report, store
    from .resonance import analyse
    from .sweep import ACCELERATION, STEPS_PER_MM, Sweep

    if args.samples:
        samples, sweep = store.load_samples(args.samples)
    else:
        told = graph.told(args) or {}
        step = 1e-3 / told.get(f'steps_per_mm_{args.axis}', STEPS_PER_MM)
        limit = 1e-3 * told.get(f'accel_limit_{args.axis}', ACCELERATION)
        sweep = Sweep(args.from_hz, args.to_hz, args.rate, step=step, acceleration=limit)
        x, y, z = (v * 1e-3 for v in args.point) if args.point else (0.0, 0.0, 0.0)
        samples = graph.measure(args, sweep, args.axis, (x, y, z) if args.point else None)
    found = analyse(samples, sweep, args.axis)
    result = outcome.of_resonance(found, sweep, datetime.now(UTC))
    lines = report.log_lines(found.candidates, found.chosen)
    print('\n'.join([*lines, result.text]))
    if args.dry_run:
        return 0
    page = report.page(result, [pictures.spectra(found), pictures.measured(found)], lines)
    path = store.save(folder(args, graph), result, page)
    store.save_samples(path.with_suffix('.npz'), samples, sweep)
    print(f'kept: {path}, report: {path.with_suffix(".html")}')
    if not args.samples:
        print(f'controller: {graph.send(args, result.settings) or "told"}')
    return 0


def steps(args: argparse.Namespace, graph: Graph) -> int:
    """Steps per mm, told to the controller. EvidenceError when its present ones are not known."""
    from . import measures, outcome
    from .evidence import EvidenceError

    told = graph.told(args)
    now = args.steps_per_mm or (told or {}).get(f'steps_per_mm_{args.axis}')
    if not now:
        raise EvidenceError(
            'no controller says its steps per mm: start the graph (waam up), or give --steps-per-mm'
        )
    found = measures.steps(args.commanded, args.measured, now)
    result = outcome.of_steps(found, args.axis, len(args.commanded), datetime.now(UTC))
    if args.dry_run:
        print(result.text)
        return 0
    correct = f'waam correct PROGRAM --scale-{args.axis} {found.scale:.6f} --out FILE'
    tells = 'waam calibrate apply tells the controller' if told is None else ''
    keep(folder(args, graph), result, [f'{tells}; until it has it: {correct}'] if tells else [])
    if told is not None:
        print(f'controller: {graph.send(args, result.settings) or "told"}; home the machine again')
    return 0


def skew(args: argparse.Namespace, graph: Graph) -> int:
    """The angle that `waam correct` takes."""
    from . import measures, outcome

    found = measures.skew(args.side_x, args.rising, args.falling, args.side_y, args.gauge)
    result = outcome.of_skew(found, datetime.now(UTC))
    note = f'programs are made true by: waam correct PROGRAM --y-to-x {found.y_to_x:.4f} --out FILE'
    keep(folder(args, graph), result, [note])
    return 0


def tool_point(args: argparse.Namespace, graph: Graph) -> int:
    """Offset of the wire tip and its limit."""
    from . import measures, outcome

    found = measures.tool_point(args.width, args.slope, args.wire)
    result = outcome.of_tool_point(found, len(args.width), datetime.now(UTC))
    note = (
        'the tool centre point can stay'
        if found.within
        else 'calibrate the tool centre point anew and measure again'
    )
    keep(folder(args, graph), result, [note])
    return 0


def show_status(args: argparse.Namespace, graph: Graph) -> int:
    """Exit status 1 when a job would be refused."""
    from . import results, store

    kept = store.load_all(folder(args, graph))
    told = graph.told(args)
    print('\n'.join(results.table(kept.results, kept.damaged, datetime.now(UTC), told)))
    return 1 if results.refusals(kept.results, kept.damaged, told) else 0


def send_all(args: argparse.Namespace, graph: Graph) -> int:
    """Tells the controller the settings of the last results. ValueError when there are none."""
    from . import results, store

    kept = store.load_all(folder(args, graph))
    if kept.damaged:
        raise ValueError('; '.join(kept.damaged))
    last = [r for r in results.newest(kept.results).values() if r.settings]
    if not last:
        raise ValueError(f'{folder(args, graph)}: no result has settings for the controller')
    for result in last:
        said = graph.send(args, result.settings)
        print(f'{result.name}: {result.text}; controller: {said or "told"}')
    return 0
