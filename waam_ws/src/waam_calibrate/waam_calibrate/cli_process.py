"""`waam calibrate wire | lead | arc`: the wire's wheel and drive, and the regulator of the arc."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .cli_common import folder, keep, verb

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    from .cli_common import Verbs
    from .graph import Graph

UNDERFEED = 'wire_underfeed_ratio'  # the controller's threshold
LEAD = """\
A bead with steps of speed is laid, wire and travel together (--program writes one; waam job run FILE --dialect waam).
From its recording (waam record, or the job folder) follow the delay and the lag of the wire drive. waam calibrate apply
tells them to the controller, which then leads the wire by them: metal per mm stays even at steps and corners.
"""
ARC = """\
The regulator of the arc's voltage is replaced by a relay: the source is switched between two voltages, up when the arc
is below its setpoint, down when it is above. With the controller: fixed gains kp 0.001, ki 1e6, kd 0, scheduling off,
trim = half the distance of the two voltages (waam_firmware/doc/arc_regulator.md). Record time, output and arc voltage
at 1 kHz or faster, some 20 swings. The result is a page with the gains after Ziegler and Nichols, the analytic ones and
those that the controller has; gains are compiled into the controller, so nothing is told to it.
"""


def register(verbs: Verbs, graph: Graph) -> None:
    """Adds the three verbs."""
    _add_wire(verbs, graph)
    _add_lead(verbs, graph)
    _add_arc(verbs, graph)


def _add_wire(verbs: Verbs, graph: Graph) -> None:
    p = verb(
        verbs, 'wire', 'counts of the wire wheel per mm, and the threshold of underfeed', graph
    )
    p.add_argument('--diameter', type=float, default=35.0, metavar='MM', help='of the wheel, 35')
    p.add_argument(
        '--counts-per-turn', type=int, required=True, metavar='N',
        help='of the encoder: 4 per line with both tracks, 1 or 2 per slot with a fork',
    )  # fmt: skip
    p.add_argument(
        '--length', nargs='+', type=float, required=True, metavar='MM', help='of wire, by a rule'
    )
    p.add_argument(
        '--counted', nargs='+', type=float, required=True, metavar='N', help='by the encoder'
    )
    p.add_argument(
        '--controller', type=float, default=40.0, metavar='N', help='counts/mm it has now (40)'
    )
    p.add_argument(
        '--slowest', type=float, default=33.0, metavar='MM/S',
        help='feed at which underfeed must still be seen (33, the slowest of feed_forward)',
    )  # fmt: skip
    p.add_argument('--threshold', type=float, default=0.9, help='of the desired feed (0.9)')
    p.add_argument(
        '--record', type=Path, help='a recorded job with normal feed: the threshold must clear it'
    )
    p.set_defaults(run_command=lambda args: wire(args, graph))


def _add_lead(verbs: Verbs, graph: Graph) -> None:
    p = verb(
        verbs, 'lead', 'delay and lag of the wire drive, from a bead with steps of speed', graph
    )
    p.epilog = LEAD
    what = p.add_mutually_exclusive_group(required=True)
    what.add_argument('--record', type=Path, help='job folder, recording or .mcap file of the bead')
    what.add_argument('--program', type=Path, metavar='FILE', help='write such a bead and stop')
    p.add_argument('--feed', type=float, default=80.0, metavar='MM/S', help='wire of it (80)')
    p.add_argument('--speed', type=float, default=8.0, metavar='MM/S', help='travel of it (8)')
    p.add_argument('--piece', type=float, default=12.0, metavar='MM', help='between two steps (12)')
    p.add_argument('--steps', type=int, default=11, help='of it (11)')
    p.add_argument(
        '--reading', type=float, default=0.01, metavar='S',
        help='by which the encoder is older than its frame: 0.01 virtual controller, 0.02 board',
    )  # fmt: skip
    p.set_defaults(run_command=lambda args: lead(args, graph))


def _add_arc(verbs: Verbs, graph: Graph) -> None:
    p = verb(verbs, 'arc', 'regulator of the arc, from a relay experiment', graph)
    p.epilog = ARC
    what = p.add_mutually_exclusive_group(required=True)
    what.add_argument(
        '--samples', type=Path, metavar='FILE', help='lines of time (s), output (V), voltage (V)'
    )
    what.add_argument(
        '--rehearse', nargs=3, type=float, metavar=('GAIN', 'LAG', 'DELAY'),
        help='the experiment on a made-up plant (V/V, s, s); nothing is kept',
    )  # fmt: skip
    p.set_defaults(run_command=lambda args: arc(args, graph))


# ---- verbs


def wire(args: argparse.Namespace, graph: Graph) -> int:
    """Geometry of the wheel, and whether it tells underfeed."""
    from . import outcome, pictures
    from . import wire as core

    feed = core.normal_feed(graph.wire(args.record)) if args.record else None
    wheel = core.Wheel(args.diameter, args.counts_per_turn)
    found = core.calibrate(wheel, args.length, args.counted, args.slowest, args.threshold, feed)
    result = outcome.of_wire(found, args.controller, UNDERFEED, datetime.now(UTC))
    turn = f'{wheel.per_turn:.2f} mm per turn, {wheel.per_count:.4g} mm per count by the wheel'
    note = f'{turn}; the controller is built with ENCODER_PER_MM {args.controller:g} (waam_firmware/stm32)'
    notes = [note, 'waam calibrate apply tells the controller the threshold']
    keep(folder(args, graph), result, notes, [pictures.wire_lengths(found)])
    return 0


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
    result = outcome.of_lead(found, datetime.now(UTC))
    keep(
        folder(args, graph), result, ['waam calibrate apply tells the controller'],
        [pictures.wire_steps(found)],
    )  # fmt: skip
    return 0


def arc(args: argparse.Namespace, graph: Graph) -> int:
    """Gains by both rules beside those of the controller."""
    from . import outcome, pictures, relay, report, store
    from .regulator import Plant, experiment

    swing = experiment(Plant(*args.rehearse)) if args.rehearse else store.load_swing(args.samples)
    found = relay.analyse(swing)
    result = outcome.of_arc(found, datetime.now(UTC))
    lines = report.gain_lines(outcome.gains_of(found), found.plant)
    if args.rehearse:
        print('\n'.join([*lines, result.text, 'a rehearsal: nothing is kept']))
        return 0
    keep(folder(args, graph), result, lines, [pictures.relay_swing(found)])
    return 0
