"""Steps of `waam commission` in which axes or wire move and nothing burns. One function a step."""

from __future__ import annotations

import math

from waam_bridge.gantry import STEPS
from waam_calibrate import commission_checks as checks
from waam_calibrate import measures, outcome, pictures, store, wire
from waam_calibrate.cli import UNDERFEED
from waam_calibrate.commission import Check, Outcome, judged
from waam_calibrate.resonance import analyse
from waam_calibrate.results import Result
from waam_calibrate.sweep import ACCELERATION, Sweep

from .commission_cell import END_MM
from .commission_visit import STAND_CLEAR, YES, Visit, at_home, keep
from .shaking import swing, unshaped

COUNTS_PER_MM = 40.0  # of the wire wheel, as the controller is built
WHEEL_MM = 35.0
WIRE_MM, PIECES = 340.0, 3
LENGTHS = {'x': (0.2, 0.5, 0.8), 'y': (0.2, 0.5, 0.8), 'z': (-0.15, -0.4, -0.65)}  # of the travel
MARGIN = 0.05  # of the travel, before the first length
SIDE_Y = (0.99, 1.01)  # what a misread length of `steps` leaves
MOST_LEFT = 25.0  # % of the vibration
FRAME = 0.5  # side of the frame over the travel
FLOWED = ('never', 'opened', 'always')  # only while the valve was told to open, or before as well
LONGEST_MM = 1000.0  # that is measured


def directions(visit: Visit) -> Outcome:
    """Z first, upwards; every axis moves by a little and back. The first wrong one ends the step."""
    cell = visit.cell
    if refused := cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop and limits')
    visit.ready(
        f'Every axis stands 20 mm from its ends at least, and moves by {checks.JOG_MM:g} mm. {STAND_CLEAR}'
    )
    text = 'which way did the torch go over the table? x: to the right, y: to the back, z: up, seen from the front'
    for axis in 'zxy':
        visit.say(f'{axis}_look', f'Look at the torch: {axis.upper()} moves next.')
        up = not cell.at_top(axis)
        cell.jog(axis, checks.JOG_MM if up else -checks.JOG_MM)
        way = visit.ask(axis, f'{axis.upper()} was moved: {text}', checks.WAYS)
        found = checks.direction(axis, f'{"+" if up else "-"}{axis}', way)
        if not found.passed:
            return found
        cell.jog(axis, -checks.JOG_MM if up else checks.JOG_MM)
    return Outcome(True, 'x, y and z move as they are told')


def homing(visit: Visit) -> Outcome:
    """Homes; where the axes then stand the operator sees."""
    cell = visit.cell
    if refused := cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop and limits')
    visit.ready(f'The machine homes: Z up, then X and Y to their switches. {STAND_CLEAR}')
    cell.home()
    seen = visit.ask(
        'ends', 'Is Z at its upper end, and do X and Y stand at their home switches?', YES
    )
    if seen != 'yes':
        text = 'the axes do not stand at their home switches'
        return Outcome(
            False, text, (), 'axes.x.home, axes.y.home of the cell file, or swapped switches'
        )
    return Outcome(True, 'homed; the axes stand at their switches')


def gas(visit: Visit) -> Outcome:
    """A strike in the air with the source off shows valve and flow switch before there is an arc."""
    cell = visit.cell
    visit.ready(
        'The source is switched off at its mains, the gas bottle is open, the torch is up and its wire touches '
        f'nothing. Wire is fed and the gas valve opens for some seconds. {STAND_CLEAR}'
    )
    at_home(visit)
    cell.go('z', cell.travel()[2] - END_MM)
    visit.say('listen', 'Listen at the nozzle, now and while the valve is told to open.')
    fault, burnt = cell.strike()
    when = 'never' if burnt else visit.ask('flowed', 'When did gas flow at the nozzle?', FLOWED)
    return checks.gas(fault, burnt, when == 'always', when != 'never')


def steps(visit: Visit) -> Outcome:
    """Three lengths an axis, all in one direction; the controller is told what follows, and homes again."""
    cell = visit.cell
    visit.ready(
        'X, Y and Z travel along most of their way, Z downwards to two thirds of it: the table is free. '
        f'A rule or dial gauge stands ready. {STAND_CLEAR}'
    )
    at_home(visit)
    now = cell.told()
    found = []
    for axis, size in zip('xyz', cell.travel(), strict=True):
        told, read = _lengths(visit, axis, min(size, LONGEST_MM), size)
        result = measures.steps(axis, told, read, now[STEPS + axis])
        keep(visit, result)
        found.append(result)
    cell.configure([setting for result in found for setting in result.settings])
    cell.home()
    shown = tuple(
        Check(f'{r.axis}, real over commanded', r.values['scale'], 1 - measures.SCALE_MOST, 1 + measures.SCALE_MOST)
        for r in found
    )  # fmt: skip
    return Outcome(True, '; '.join(f'{r.axis} {r.text}' for r in found), shown)


def _lengths(visit: Visit, axis: str, most: float, size: float) -> tuple[list[float], list[float]]:
    """Commanded and measured lengths, mm; every one from the same place."""
    told = [round(share * most) for share in LENGTHS[axis]]
    start = size * (1 - MARGIN) if told[0] < 0 else size * MARGIN
    for number, length in enumerate(told, 1):
        visit.cell.go(axis, start)
        visit.say(f'{axis}_zero', f'Set the gauge of {axis.upper()} to zero.')
        visit.cell.go(axis, start + length)
        text = f'{axis.upper()} was told to travel {abs(length)} mm. Write down how far it went.'
        visit.say(f'{axis}_read_{number}', text)
    lengths = [float(abs(v)) for v in told]
    text = f'How far did {axis.upper()} go, told {", ".join(f"{v:g}" for v in lengths)} mm?'
    read = visit.numbers(axis, text, len(told), 0.5 * lengths[0], 1.5 * lengths[-1], 'mm')
    return lengths, read


def skew(visit: Visit) -> Outcome:
    """A frame of four marks and its diagonals; the side along X is as long as it was told, since `steps`."""
    cell = visit.cell
    visit.ready(
        f'The torch goes to the four corners of a square, where you mark its place. {STAND_CLEAR}'
    )
    at_home(visit)
    x, y, _ = cell.travel()
    side = round(FRAME * min(x, y, LONGEST_MM))
    low = {'x': 0.5 * (x - side), 'y': 0.5 * (y - side)}
    for number, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1)), 1):
        cell.go('x', low['x'] + u * side)
        cell.go('y', low['y'] + v * side)
        visit.say(f'mark_{number}', f'Mark the place of the torch on the table: {number}.')
    rising, falling = visit.numbers(
        'diagonals', 'How far is it from mark 1 to mark 3, and from 2 to 4?', 2, side, 2.0 * side, 'mm'
    )  # fmt: skip
    result = measures.skew(side, rising, falling)
    keep(visit, result)
    leans, most = result.values['y_to_x_deg'], measures.LARGEST_SKEW
    shown = (
        Check('y leans towards x', leans, -most, most, 'deg'),
        Check('side along Y by the diagonals, over that told', result.values['side_y_mm'] / side, *SIDE_Y),
    )  # fmt: skip
    if result.refuses:
        mend = 'square the rails of Y; what is left is corrected by waam correct --y-to-x'
        return Outcome(False, result.refuses, shown, mend)
    return judged(shown, result.text, 'a diagonal or a length of steps was misread: steps again')


def wheel(visit: Visit) -> Outcome:
    """Three lengths of wire against its wheel."""
    visit.ready(
        'The source is off. Three lengths of wire are fed into the air; cut it flush with the tip first.'
    )
    if refused := visit.cell.reset():
        return Outcome(False, f'the controller says: {refused}', (), 'repeat estop')
    counts = []
    for number in range(1, PIECES + 1):
        counts.append(visit.cell.feed_wire(WIRE_MM) * COUNTS_PER_MM)
        visit.say(f'cut_{number}', f'Cut the wire flush with the tip and keep it: piece {number}.')
    text = 'How long are the pieces, in the order in which they were cut?'
    lengths = visit.numbers('pieces', text, PIECES, 0.5 * WIRE_MM, 1.5 * WIRE_MM, 'mm')
    per_turn = round(math.pi * WHEEL_MM * COUNTS_PER_MM)
    found = wire.calibrate(wire.Wheel(WHEEL_MM, per_turn), lengths, counts, slowest=33.0)
    result = outcome.of_wire(found, COUNTS_PER_MM, UNDERFEED)
    picture = pictures.wire_lengths(found)
    keep(visit, result, [picture])
    visit.draw('wire', picture)
    off = 100 * (found.per_mm / COUNTS_PER_MM - 1)
    shown = Check('counted over fed, off', off, -5.0, 5.0, '%')
    if result.refuses:
        return Outcome(
            False,
            result.refuses,
            (shown,),
            'wheel: diameter, slip, pressure; or another ENCODER_PER_MM',
        )
    visit.cell.configure(result.settings)
    return Outcome(True, result.text, (shown,))


def resonance(visit: Visit) -> Outcome:
    """A sweep of X and of Y, as `waam calibrate resonance` makes it; the controller is told the shapers."""
    cell = visit.cell
    if nothing := cell.deaf():
        text = f'{nothing}: the resonance is not known, and no shaper is set'
        return Outcome(False, text, (), 'an ADXL345 at the controller', there=False)
    visit.ready(
        'The torch goes to the middle of the table, at the top. X, then Y swing there by 2 mm for more than a minute '
        f'each; the arc stays off. {STAND_CLEAR}'
    )
    at_home(visit)
    for axis, size in zip(
        'zxy', (2 * cell.travel()[2] - 2 * END_MM, *cell.travel()[:2]), strict=True
    ):
        cell.go(axis, 0.5 * size)
    found = [_swung(visit, axis) for axis in 'xy']
    shown = tuple(
        Check(
            f'{r.axis}: vibration left by the shaper',
            r.values['vibration_pct'],
            0.0,
            MOST_LEFT,
            '%',
        )
        for r in found
    )
    return judged(
        shown, '; '.join(f'{r.axis} {r.text}' for r in found), 'loose axis, belt or sensor'
    )


def _swung(visit: Visit, axis: str) -> Result:
    cell = visit.cell
    told = cell.told()
    limit = 1e-3 * told.get(f'accel_limit_{axis}', ACCELERATION)
    sweep = Sweep(step=1e-3 / told[STEPS + axis], acceleration=limit)
    cell.blocks.clear()
    with unshaped(cell, axis):
        samples = swing(cell, sweep, axis, None)
    found = analyse(samples, sweep, axis)
    result = outcome.of_resonance(found, sweep)
    drawn = [pictures.spectra(found), pictures.measured(found)]
    path = keep(visit, result, drawn)
    store.save_samples(path.with_suffix('.npz'), samples, sweep)
    visit.draw(f'resonance_{axis}', drawn[0])
    cell.configure(result.settings)
    return result
