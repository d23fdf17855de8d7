"""Steps of `waam commission` with an arc: every one is a job of the graph, which has its interlocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from waam_calibrate import commission_beads as beads
from waam_calibrate import lead as drive
from waam_calibrate import outcome, pictures
from waam_calibrate.commission import Check, CommissionError, Outcome
from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus
from waam_node import job_folder
from waam_process.cell_keys import KEYS, MATERIAL, PLATE
from waam_process.grid import GridSpec
from waam_process.loop_mode import LoopMode
from waam_process.materials import get
from waam_process.operating import DEFAULT_MATERIAL
from waam_process.units import to_mm_min

from . import calibrate, paths
from .client import ClientError, GraphClient
from .commission_scanner import in_force
from .commission_visit import STAND_CLEAR, Visit, at_home, keep, may_burn
from .progress import JobProgress

ARC_MM = 60.0  # first bead
LEAD_FEED, LEAD_SPEED, PIECE_M, LEAD_STEPS = 0.080, 0.008, 0.012, 11  # as of waam calibrate lead
LEAD_VOLTAGE, FASTER = 22.0, 1.5  # of that program; its second regime over the first
BESIDE_M = 0.03  # second bead beside the first
ENDS_M = 0.003  # of a piece, which the drive spoils
READ_VIRTUAL_S, READ_BOARD_S = 0.01, 0.02  # by which the encoder is older than its frame
FINISH = 'finish=machined'
NO = 'no'
HOT = (
    'Screens and gloves are on, the source and its gas are on, cables and extraction are seen to. The arc burns, and '
    f'the emergency stop is the way to end it at once. {STAND_CLEAR}'
)


def arc(visit: Visit) -> Outcome:
    """A first bead on scrap: current, voltage, wire, and an arc that stays."""
    in_force(visit)
    material = get(_wire(visit))
    zero = visit.file.values.get(PLATE) or [
        float(v) for v in KEYS[PLATE].example.strip('[]').split(',')
    ]
    corner = ', '.join(f'{v:g}' for v in zero)
    visit.say(
        'plate',
        'Clamp a scrap plate of steel, 200 x 80 mm and more, its corner at work zero and its top as high as '
        f'work.plate_mm says ({corner} mm from that corner is zero).',
    )
    _begin(visit, f'A bead of {ARC_MM:g} mm is laid on the bare plate. {HOT}')
    rows = [
        '; first arc', 'G21 G90', 'G0 Z10', 'G0 X0 Y0', f'G1 Z0 F600 W{to_mm_min(material.wire_feed):.0f} '
        f'S{material.voltage:g}', 'M3', f'G1 X{ARC_MM:g} F{to_mm_min(material.speed):.0f}', 'M5', 'G0 Z10', '',
    ]  # fmt: skip
    done = _program(visit, '\n'.join(rows), 0.0)
    if not done.passed:
        return done
    record = calibrate.arc(Path(visit.job))
    return beads.arc(record, material.wire_feed, material.voltage, material)


def lead(visit: Visit) -> Outcome:
    """A bead with steps of speed, and what `waam calibrate lead` makes of it."""
    length = 1e3 * PIECE_M * (LEAD_STEPS + 1)
    place = f'{1e3 * BESIDE_M:g} mm behind the first bead, where the plate is bare'
    _begin(visit, f'A bead of {length:g} mm with steps of speed is laid {place}. {HOT}')
    done = _program(visit, drive.program(LEAD_FEED, LEAD_SPEED, PIECE_M, LEAD_STEPS), BESIDE_M)
    if not done.passed:
        return done
    reading = READ_BOARD_S if visit.cell.board else READ_VIRTUAL_S
    found = drive.identify(calibrate.wire(Path(visit.job)), reading)
    result = outcome.of_lead(found)
    picture = pictures.wire_steps(found)
    keep(visit, result, [picture])
    visit.draw('lead', picture)
    shown = (
        Check('delay of the wire', 1e3 * found.delay, 0.0, 1e3 * drive.MAX_LEAD[0], 'ms'),
        Check('lag of the wire', 1e3 * found.lag, 0.0, 1e3 * drive.MAX_LEAD[1], 'ms'),
    )  # fmt: skip
    if result.refuses:
        return Outcome(False, result.refuses, shown, 'feeder: liner, rolls, length of the wire')
    visit.cell.configure(result.settings)
    return Outcome(True, result.text, shown)


def bead(visit: Visit) -> Outcome:
    """The beads of `arc` and `lead` against the table of regimes, by the maps of their jobs."""
    material = get(_wire(visit))
    feed, speed, voltage = material.wire_feed, material.speed, material.voltage
    first = beads.Bead('first arc', (0.02, 1e-3 * ARC_MM - 0.015), 0.0, feed, speed, voltage)
    found = [(first, _sections(visit.laid['arc'], [first])[0])]
    for name, factor in (('slow', 1.0), ('fast', FASTER)):
        pieces = _pieces(factor)
        seen = _sections(visit.laid['lead'], pieces)
        found.append((replace(pieces[0], name=name), beads.mean_of(seen)))
    return beads.beads(found, material)


def _pieces(factor: float) -> list[beads.Bead]:
    """Of the bead of `lead` with this regime, without the first and the last: the arc starts and ends there."""
    regime = LEAD_FEED * factor, LEAD_SPEED * factor, LEAD_VOLTAGE
    found = []
    for k in range(1, LEAD_STEPS):
        if (k % 2 == 1) is (factor != 1.0):
            x = (k * PIECE_M + ENDS_M, (k + 1) * PIECE_M - ENDS_M)
            found.append(beads.Bead(f'piece {k}', x, BESIDE_M, *regime))
    return found


def _sections(job: str, wanted: list[beads.Bead]) -> list[beads.Section]:
    """By the first and the last map of a job. ClientError when they are gone."""
    files = job_folder.map_files(Path(job))
    if len(files) < 2:
        raise ClientError(f'{job}: the maps of that job are gone; repeat arc and lead')
    with np.load(files[0]) as a, np.load(files[-1]) as b:
        x, y = (float(v) for v in b['origin'])
        spec = GridSpec(x, y, float(b['resolution']), *b['z'].shape)
        before, after = a['z'].astype(float), b['z'].astype(float)
    return [beads.section(piece, spec, before, after) for piece in wanted]


def part(visit: Visit) -> Outcome:
    """A part that is restored in closed loop by a job; its verdict."""
    in_force(visit)
    visit.say(
        'place',
        'Clamp a small worn part of steel where jobs expect it (work zero): 40 to 90 mm long, some mm deep, its '
        'nominal mesh on this computer.',
    )
    text = f'The part is restored. {HOT} It begins when you name the file of its nominal mesh (mm).'
    nominal = visit.ask('nominal', text, (NO,), file=True)
    if nominal == NO:
        raise CommissionError(f'step {visit.step.name}: the operator is not ready')
    _ready_for_jobs(visit)
    mesh = str(Path(nominal).expanduser().resolve())
    done, result = _job(
        visit, part=mesh, mode='restore', loop_mode=LoopMode.CLOSED_LOOP, plan_settings=[FINISH]
    )
    if not done.passed:
        return done
    shown = (Check('verdict of the job', float(result.in_tolerance), 1.0, 1.0),)
    if not result.in_tolerance:
        return Outcome(False, result.message, shown, f'{visit.job}/report.html says where')
    return Outcome(True, result.message, shown)


class Paused:
    """Aborts a job that pauses, for what makes it pause is to be mended before the step is repeated. why: it paused."""

    def __init__(
        self, client: GraphClient, progress: JobProgress, trouble: Callable[[], str]
    ) -> None:
        self._client, self._progress, self._trouble = client, progress, trouble
        self.why, self._aborted = '', False

    def heard(self, status: JobStatus) -> None:
        """Of the running job."""
        self._progress(status)
        if status.state == JobStatus.PAUSED:
            self.why = self.why or status.message

    def look(self) -> str:
        """Why the graph cannot finish the job, '' = it can."""
        if self.why and not self._aborted:
            self._aborted = True
            self._client.trigger('job_sequencer/abort')
        return self._trouble()


def _begin(visit: Visit, text: str) -> None:
    in_force(visit)
    visit.ready(text)
    _ready_for_jobs(visit)


def _ready_for_jobs(visit: Visit) -> None:
    at_home(visit)
    may_burn(visit)


def _wire(visit: Visit) -> str:
    """Key of the table of materials."""
    return str(visit.file.values.get(MATERIAL, DEFAULT_MATERIAL))


def _program(visit: Visit, text: str, aside: float) -> Outcome:
    """Lays a program on a plate, `aside` m along y."""
    file = visit.folder / f'{visit.step.name}.gcode'
    file.write_text(text)
    goal = RunJob.Goal()
    goal.program_shift.y = aside
    done, _ = _job(
        visit, program=str(file), dialect='waam', mode='build', loop_mode=LoopMode.MONITOR,
        program_shift=goal.program_shift,
    )  # fmt: skip
    return done


def _job(visit: Visit, **fields: object) -> tuple[Outcome, RunJob.Result]:
    """Runs it; its folder is that of the visit then. Passed: it has ended in order."""
    nan = math.nan
    goal = RunJob.Goal(
        name=f'commission_{visit.step.name}', jobs_dir=str(paths.jobs_dir()), material=_wire(visit),
        k_gain=nan, layer_height=nan, bead_width=nan, tolerance=nan, notes=['commissioning=yes'], fresh=True, **fields,
    )  # fmt: skip
    with GraphClient(visit.cell.domain) as client, JobProgress(goal.name) as progress:
        paused = Paused(client, progress, visit.cell.trouble)
        result = client.run_job(goal, paused.heard, paused.look)
    visit.job = result.job_dir
    if result.error_code:
        text = '; '.join(
            filter(None, (paused.why, f'{result.message} (error {result.error_code})'))
        )
        return Outcome(False, text, (), 'what the job says; waam status'), result
    return Outcome(True, result.message), result
