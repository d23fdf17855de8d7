"""The verbs of `waam job`: from the command line to the goal, and from the result to a message and an exit status."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from waam_job.cli_program import asked_of, with_finish, with_shaft
from waam_msgs.action import RunJob
from waam_msgs.srv import AdjustJob
from waam_node import job_folder
from waam_process.operating import SPEED_FACTOR, WIRE_FACTOR, build_plate

from . import calibrate
from .cell_desk import material
from .cli_common import run_and_domain
from .client import ClientError, GraphClient
from .operate import ended, graph_watch, require_up
from .paths import jobs_dir
from .progress import JobProgress
from .run_state import RunState

if TYPE_CHECKING:  # the planner is loaded only when a job is checked
    from waam_job.model.goal import Checked

_R = RunJob.Result
REFUSED = (
    _R.BUSY, _R.BAD_GOAL, _R.BAD_PART, _R.UNKNOWN_MATERIAL, _R.PLAN_FAILED, _R.BAD_RESUME,
    _R.BAD_PROGRAM,
)  # fmt: skip


def notes_of(args: argparse.Namespace) -> list[str]:
    """--note, --wire-lot and --gas as the notes of a job."""
    told = {'wire_lot': getattr(args, 'wire_lot', ''), 'gas': getattr(args, 'gas', '')}
    return [*args.note, *(f'{k}={v}' for k, v in told.items() if v)]


def _goal_fields(args: argparse.Namespace) -> dict[str, Any]:
    """Fields of the goal that the command line gives, in SI; named as in RunJob.Goal and in JobGoal."""
    return {
        'name': args.name,
        'material': material(args.material),
        'layers': args.layers,
        'layer_height': args.layer_height * 1e-3,
        'bead_width': args.bead_width * 1e-3,
        'k_gain': args.k_gain,
        'tolerance': args.tolerance * 1e-3,
        'scale': args.scale,
        'notes': tuple(notes_of(args)),
        'strategy': args.strategy,
        'allowance': args.allowance * 1e-3,
        'passes': args.passes,
        'wire_left': args.wire_left,
        'plan_settings': (*with_finish(args), *with_shaft(args), *getattr(args, 'set', ())),
        'repair': getattr(args, 'repair', False),
        'operator_name': getattr(args, 'operator', ''),
        'fresh': getattr(args, 'fresh', False),
    }


def make_goal(args: argparse.Namespace, jobs: Path, learned: Path | None = None) -> RunJob.Goal:
    """The goal of `waam job run` (mm on the command line, m in the goal). learned: folder of what jobs have taught,
    None = that in `jobs`."""
    fields, asked = _goal_fields(args), asked_of(args).goal_fields()
    program, shift = asked.pop('program'), asked.pop('program_shift')
    asked['part'] = str(asked['part']) if asked['part'].name else ''
    goal = RunJob.Goal(jobs_dir=str(jobs), **fields, **asked)
    goal.learned_dir, goal.program = str(learned or ''), str(program or '')
    goal.program_shift.x, goal.program_shift.y, goal.program_shift.z = shift
    return goal


def cell_notes(state: RunState) -> list[str]:
    """Preset of the simulated cell as a note of the job, so that its report names it."""
    return [f'preset={state.preset}'] if state.preset else []


def check_arguments(args: argparse.Namespace) -> Checked:
    """Refuses what can be refused without a graph. Returns the job with part and program read."""
    checked = checked_of(args)
    if args.as_found and not args.as_found.exists():
        raise ValueError(f'--as-found {args.as_found}: no such file')
    check_calibration(args)
    return checked


def checked_of(args: argparse.Namespace) -> Checked:
    """Part and program read. ValueError with everything that is wrong with them."""
    from waam_job.model.goal import JobError, JobGoal, check

    goal = JobGoal(jobs_dir=Path('.'), **_goal_fields(args), **asked_of(args).goal_fields())
    for name in ('layers', 'passes'):
        if getattr(args, name) < 0:
            raise ValueError(f'--{name} is {getattr(args, name)}, must not be negative')
    try:
        return check(goal, goal.shaft_diameter > 0)  # the sequencer knows what the cell has
    except JobError as e:
        raise ValueError(str(e)) from None


def check_calibration(args: argparse.Namespace) -> None:
    """ValueError with every reason of `waam calibrate status` why no job may run or go on."""
    reasons = [] if getattr(args, 'ignore_calibration', False) else calibrate.check(args)
    if reasons:
        raise ValueError(f'{"; ".join(reasons)} (waam calibrate status; --ignore-calibration)')


def run_job(args: argparse.Namespace) -> int:
    """0 done, 1 failed, 2 refused, 130 cancelled."""
    run, domain = run_and_domain(args)
    checked = check_arguments(args)
    state = require_up(run)
    jobs = (args.jobs or jobs_dir()).resolve()
    with GraphClient(domain) as client:
        if state.simulated:
            place_part(client, args, checked)
        elif args.as_found:
            raise ValueError(
                '--as-found is for the simulated cell; on a real one the part is on the table'
            )
        goal = make_goal(args, jobs)
        goal.notes = [*goal.notes, *cell_notes(state)]
        return _follow(client, goal, args.part.stem, run)


def go_on(args: argparse.Namespace) -> int:
    """Goes on with a paused job; otherwise, or with a folder, resumes an interrupted one on the part that is on the
    table. Exit status as of `run_job`."""
    run, domain = run_and_domain(args)
    require_up(run)
    if args.folder is None:
        with GraphClient(domain) as client:
            if client.resume():
                print('resume: accepted')
                return 0
    folder = (args.folder or jobs_dir() / job_folder.LATEST).resolve()
    if not (folder / job_folder.JOB).is_file():
        raise ValueError(f'{folder} is no job folder (there is no {job_folder.JOB} in it)')
    check_calibration(args)  # a loss of power takes the controller's settings along
    goal = RunJob.Goal(
        resume_dir=str(folder), notes=notes_of(args), operator_name=args.operator, wire_left=args.wire_left
    )  # fmt: skip
    with GraphClient(domain) as client:
        return _follow(client, goal, folder.name, run)


def _follow(client: GraphClient, goal: RunJob.Goal, title: str, run: Path) -> int:
    with JobProgress(title) as progress:
        result = client.run_job(goal, progress, graph_watch(run))
    return report_result(result, ended(run))


def switch(args: argparse.Namespace) -> int:
    """Pause or abort (`args.verb`). ClientError when the job sequencer refuses."""
    run, domain = run_and_domain(args)
    require_up(run)
    with GraphClient(domain) as client:
        client.trigger(f'job_sequencer/{args.verb}')
    print(f'{args.verb}: accepted')
    return 0


def adjust(args: argparse.Namespace) -> int:
    """Gain, rescan or skip of the running job. ClientError when it is refused."""
    run, domain = run_and_domain(args)
    require_up(run)
    request = AdjustJob.Request(code=getattr(AdjustJob.Request, args.code), value=float(args.value))
    with GraphClient(domain) as client:
        # not repeated: a second SKIP_LAYER would leave another layer out
        response = client.call(AdjustJob, 'job_sequencer/adjust', request, repeat=False)
    if not response.success:
        raise ClientError(response.message)
    print('accepted; in force from the next layer on')
    return 0


def feed(args: argparse.Namespace) -> int:
    """Overrides travel speed and wire feed at once; prints the factors that the controller then reports."""
    run, domain = run_and_domain(args)
    require_up(run)
    for name, value, (low, high) in (
        ('speed', args.speed, SPEED_FACTOR),
        ('wire', args.wire, WIRE_FACTOR),
    ):
        if not (math.isnan(value) or low <= value <= high):
            raise ValueError(f'--{name} {value:g} must be {low:g} to {high:g}')
    if math.isnan(args.speed) and math.isnan(args.wire):
        raise ValueError('say what is to change: --speed FACTOR, --wire FACTOR')
    with GraphClient(domain) as client:
        who = os.environ.get('USER') or 'command line'
        speed, wire = client.override(args.speed, args.wire, who)
    print(f'in force: travel speed x {speed:g}, wire feed x {wire:g}')
    return 0


def place_part(
    client: GraphClient, args: argparse.Namespace, checked: Checked, seed: int = -1
) -> None:
    """Simulated cell: the worn part where the program expects it, a worn shaft in its chuck, or for a build a plate
    under all that it reaches. seed: of everything random in the cell; -1 = as configured."""
    if running := client.running_job():
        raise ClientError(
            f'a job is running already: {running.job_id} (waam status, waam job abort)'
        )
    if asked_of(args).mode == 'build':
        client.load_part('', build_plate(checked.bounds[1].tolist()), seed)
        return
    worn = args.part if checked.shaft else args.as_found
    if not worn:
        raise ValueError(
            'the simulated table is empty: say with --as-found which worn mesh lies on it (or use --mode build)'
        )
    lies = checked.on_table(worn)
    for note in lies.notes:
        print(f'as found: {note}')
    with TemporaryDirectory() as folder:
        file = Path(folder) / 'as_found.npz'
        lies.heights.save_npz(file)
        shaft = checked.shaft
        size = (shaft.diameter, shaft.level, 0.0) if shaft else (0.0, 0.0, 0.0)
        client.load_part(str(file), size, seed)


def report_result(result: RunJob.Result, gone: Sequence[str] = ()) -> int:
    """Writes the report and says how the job ended. Exit status: 0; 1 failed; 2 refused; 130 aborted. gone: processes
    that ended meanwhile, and how."""
    from waam_view.report import write_report

    code = result.error_code
    if result.job_dir:
        page = write_report(Path(result.job_dir))
        print(f'report: {page}')
    if code:
        print(f'waam: error {code}: {"; ".join([result.message, *gone])}', file=sys.stderr)
        if code == RunJob.Result.ABORTED:
            return 130
        return 2 if code in REFUSED else 1
    print(f'done: {result.layers} layers, {result.message}')
    return 0
