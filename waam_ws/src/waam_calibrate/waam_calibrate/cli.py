"""`waam calibrate`: measures, judges, keeps the result with its date, and tells the controller."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_process.cli_options import Verbs, add_verb

from . import cli_robot
from .cli_common import SEVERAL, WANTED, folder, keep

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
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
  waam calibrate robot-tcp --file touches.csv           tip of a robot's tool, from touches of a fixed point
  waam calibrate hand-eye --file profiles.csv           scanner on a robot, from profiles of a sphere
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
LEAD = """\
A bead with steps of speed is laid, wire and travel together (--program writes one; waam job run FILE --dialect waam).
From its recording (waam record, or the job folder) follow the delay and the lag of the wire drive. waam calibrate apply
tells them to the controller, which then leads the wire by them: metal per mm stays even at steps and corners.
"""
UNDERFEED = 'wire_underfeed_ratio'  # the controller's threshold
DRY_RUN = ('--dry-run', False, 'tell the controller nothing and keep nothing')


def register(commands: Verbs, graph: Graph) -> None:
    """Adds the verb to the waam command."""
    p = add_verb(
        commands, 'calibrate', 'resonance, steps per mm, skew, tool centre point, wire, robot; what is calibrated',
        description='Calibration of the machine. Every result is kept with its date and judged.', epilog=EPILOG,
    )  # fmt: skip
    verbs = p.add_subparsers(dest='calibrate_command', metavar='VERB', required=True)

    def add(
        name: str,
        run: Callable[..., int],
        text: str,
        *rows: Any,
        on_graph: bool = False,
        epilog: str = '',
    ) -> Any:
        """A verb; on_graph: it needs options that name a graph."""
        q = add_verb(verbs, name, text, *rows, epilog=epilog)
        text = 'where results lie (default: calibrations/ or $WAAM_CALIBRATIONS)'
        q.add_argument('--calibrations', type=Path, metavar='DIR', help=text)
        if on_graph:
            graph.add_options(q)
        q.set_defaults(run_command=lambda args: run(args, graph))
        return q

    add(
        'resonance', resonance, 'shake an axis, choose its input shaper and acceleration',
        ('--axis', str, 'of the machine', None, WANTED | {'choices': ('x', 'y')}),
        ('--point', float, 'probe point, work frame, mm (default: where the torch is)', ('X', 'Y', 'Z'), {'nargs': 3}),
        ('--from-hz', 1.0, 'default 1', 'HZ'), ('--to-hz', 134.0, 'default 134', 'HZ'),
        ('--rate', 2.0, 'Hz per second, 2', 'HZ/S'),
        ('--samples', Path, 'samples of an earlier sweep (.npz beside its result) instead of a machine', 'FILE'),
        DRY_RUN, on_graph=True, epilog=RESONANCE,
    )  # fmt: skip
    add(
        'steps', steps, 'steps per mm of an axis, from travels that were measured',
        ('--axis', str, 'of the machine', None, WANTED | {'choices': ('x', 'y', 'z')}),
        ('--commanded', float, 'travels, mm, all in one direction', 'MM', SEVERAL),
        ('--measured', float, 'by gauge, mm, same order', 'MM', SEVERAL),
        ('--steps-per-mm', float, 'of the controller when the travels were made (default: what it says now)', 'N'),
        DRY_RUN, on_graph=True,
    )  # fmt: skip
    add(
        'skew', skew, 'angle between x and y, from a frame that was measured',
        ('--side-x', float, 'along x', 'MM', WANTED), ('--rising', float, 'diagonal from the origin', 'MM', WANTED),
        ('--falling', float, 'the other one', 'MM', WANTED),
        ('--side-y', float, 'along y, to check the others', 'MM'),
        ('--gauge', 0.05, 'uncertainty of a length (0.05)', 'MM'),
    )  # fmt: skip
    add(
        'tcp', tool_point, 'tool centre point, from the steps of a bead on a flank',
        ('--width', float, 'of a step', 'MM', SEVERAL), ('--slope', float, 'of the flank', 'DEG', WANTED),
        ('--wire', float, 'diameter of wire or beam', 'MM', WANTED),
    )  # fmt: skip
    add(
        'wire', wire, 'counts of the wire wheel per mm, and the threshold of underfeed',
        ('--diameter', 35.0, 'of the wheel, 35', 'MM'),
        ('--counts-per-turn', int, 'of the encoder: 4 per line with both tracks, 1 or 2 per slot with a fork', 'N',
         WANTED),
        ('--length', float, 'of wire, by a rule', 'MM', SEVERAL), ('--counted', float, 'by the encoder', 'N', SEVERAL),
        ('--controller', 40.0, 'counts/mm it has now (40)', 'N'),
        ('--slowest', 33.0, 'feed at which underfeed must still be seen (33, the slowest of feed_forward)', 'MM/S'),
        ('--threshold', 0.9, 'of the desired feed (0.9)'),
        ('--record', Path, 'a recorded job with normal feed: the threshold must clear it'),
    )  # fmt: skip
    p = add(
        'lead', lead, 'delay and lag of the wire drive, from a bead with steps of speed',
        ('--feed', 80.0, 'wire of it (80)', 'MM/S'), ('--speed', 8.0, 'travel of it (8)', 'MM/S'),
        ('--piece', 12.0, 'between two steps (12)', 'MM'), ('--steps', 11, 'of it (11)'),
        ('--reading', 0.01, 'by which the encoder is older than its frame: 0.01 virtual controller, 0.02 board', 'S'),
        epilog=LEAD,
    )  # fmt: skip
    what = p.add_mutually_exclusive_group(required=True)
    what.add_argument('--record', type=Path, help='job folder, recording or .mcap file of the bead')
    what.add_argument('--program', type=Path, metavar='FILE', help='write such a bead and stop')
    cli_robot.register(add)
    add(
        'status', show_status, 'what is calibrated, when, and what a job will refuse', on_graph=True
    )
    add('apply', send_all, 'tell the controller the settings of all results again', on_graph=True)


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
    result = outcome.of_resonance(found, sweep).of(datetime.now(UTC))
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
    from . import measures
    from .evidence import EvidenceError

    told = graph.told(args)
    now = args.steps_per_mm or (told or {}).get(f'steps_per_mm_{args.axis}')
    if not now:
        raise EvidenceError(
            'no controller says its steps per mm: start the graph (waam up), or give --steps-per-mm'
        )
    result = measures.steps(args.axis, args.commanded, args.measured, now)
    if args.dry_run:
        print(result.text)
        return 0
    correct = f'waam correct PROGRAM --scale-{args.axis} {result.values["scale"]:.6f} --out FILE'
    tells = 'waam calibrate apply tells the controller' if told is None else ''
    keep(folder(args, graph), result, [f'{tells}; until it has it: {correct}'] if tells else [])
    if told is not None:
        print(f'controller: {graph.send(args, result.settings) or "told"}; home the machine again')
    return 0


def skew(args: argparse.Namespace, graph: Graph) -> int:
    """The angle that `waam correct` takes."""
    from . import measures

    result = measures.skew(args.side_x, args.rising, args.falling, args.side_y, args.gauge)
    note = f'programs are made true by: waam correct PROGRAM --y-to-x {result.values["y_to_x_deg"]:.4f} --out FILE'
    return keep(folder(args, graph), result, [note])


def tool_point(args: argparse.Namespace, graph: Graph) -> int:
    """Offset of the wire tip and its limit."""
    from . import measures

    result = measures.tool_point(args.width, args.slope, args.wire)
    note = (
        'the tool centre point can stay'
        if not result.refuses
        else 'calibrate the tool centre point anew and measure again'
    )
    return keep(folder(args, graph), result, [note])


def wire(args: argparse.Namespace, graph: Graph) -> int:
    """Geometry of the wheel, and whether it tells underfeed."""
    from . import outcome, pictures
    from . import wire as core

    feed = core.normal_feed(graph.wire(args.record)) if args.record else None
    wheel = core.Wheel(args.diameter, args.counts_per_turn)
    found = core.calibrate(wheel, args.length, args.counted, args.slowest, args.threshold, feed)
    result = outcome.of_wire(found, args.controller, UNDERFEED)
    turn = f'{wheel.per_turn:.2f} mm per turn, {wheel.per_count:.4g} mm per count by the wheel'
    note = f'{turn}; the controller is built with ENCODER_PER_MM {args.controller:g} (waam_firmware/stm32)'
    notes = [note, 'waam calibrate apply tells the controller the threshold']
    return keep(folder(args, graph), result, notes, [pictures.wire_lengths(found)])


def lead(args: argparse.Namespace, graph: Graph) -> int:
    """Delay and lag of the drive, or the program for the bead that shows them."""
    from . import lead as core
    from . import outcome, pictures

    if args.program:
        text = core.program(1e-3 * args.feed, 1e-3 * args.speed, 1e-3 * args.piece, args.steps)
        args.program.write_text(text)
        print(f'{args.program}: lay it with waam job run {args.program} --dialect waam')
        return 0
    found = core.identify(graph.wire(args.record), args.reading)
    result = outcome.of_lead(found)
    note = 'waam calibrate apply tells the controller'
    return keep(folder(args, graph), result, [note], [pictures.wire_steps(found)])


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
