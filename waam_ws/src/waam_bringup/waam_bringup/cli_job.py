"""`waam job`: run jobs, adjust the running one, resume an interrupted one."""

from __future__ import annotations

import argparse
from pathlib import Path

from waam_job.cli_program import PART_HELP, add_loop_mode, add_program
from waam_job.model.limits import K_GAIN_MAX
from waam_process.operating import DEFAULT_MATERIAL, SPEED_FACTOR, WIRE_FACTOR

from .cli_common import add_run, run_and_domain


def register_job(commands: argparse._SubParsersAction) -> None:
    """Adds `waam job` and its verbs."""
    parser = commands.add_parser(
        'job',
        help='run and steer jobs',
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='while a job runs, from any other terminal (or the panel):\n'
        '  waam job pause                   the arc ends properly, the machine holds; waam job resume goes on\n'
        '  waam job rescan                  measure again before the next layer\n'
        '  waam job gain 0.15               less authority for the correction, from the next layer on\n'
        '  waam job feed --speed 0.9        travel speed and wire feed of what is being laid, at once\n'
        '  waam job skip-layer              leave the next layer out\n'
        '  waam job abort                   safe end; waam job resume FOLDER goes on with it later\n\n'
        'after a crash or a power cut: waam up, then waam job resume',
    )
    job = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    _register_run(job)
    _register_resume(job)
    _register_steering(job)


def _register_run(job: argparse._SubParsersAction) -> None:
    p = job.add_parser(
        'run',
        help='run a job on the graph that is up and follow it',
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='examples:\n'
        '  waam job run jaw_nominal.stl --as-found jaw_worn.stl --material er70s-6\n'
        '  waam job run vase.stl --mode build --layers 3 --loop-mode monitor\n'
        '  waam job run bracket.3mf --mode build --repair --set levels=adaptive --set overhang=flag\n'
        '  waam job run vase.gcode --dialect slicer --nominal vase.stl     the path of another slicer, corrected\n'
        '  waam job run wall.nc --dialect mywelder.yaml                    without a nominal part: monitor\n\n'
        'exit status: 0 done, 1 the job failed, 2 it was refused, 130 cancelled with Ctrl-C',
    )
    add_run(p)
    _add_part(p)
    _add_process(p)
    _add_bookkeeping(p)
    p.set_defaults(run_command=cmd_job_run)


def _add_part(p: argparse.ArgumentParser) -> None:
    p.add_argument('part', type=Path, help=PART_HELP)
    add_program(p)
    p.add_argument(
        '--as-found', type=Path, help='simulated cell: mesh of the worn part that lies on the table'
    )
    p.add_argument(
        '--mode',
        choices=('restore', 'build'),
        help='restore: nominal minus scan (default for a part); build: onto a flat plate (default for a program '
        'without --as-found)',
    )
    p.add_argument(
        '--scale',
        type=float,
        default=1e-3,
        help='metres per unit of the file (default 0.001: millimetres)',
    )
    p.add_argument(
        '--allowance',
        type=float,
        default=0.0,
        metavar='MM',
        help='metal left on top of the nominal part for machining',
    )
    p.add_argument(
        '--passes',
        type=int,
        default=1,
        help='2 = half of the layers, then plan again from the scan (a posteriori)',
    )
    p.add_argument(
        '--strategy', default='', help='how layers are filled (waam plan --help); default: chosen'
    )
    p.add_argument(
        '--layers', type=int, default=0, help='at most so many layers; 0 = as many as needed'
    )
    p.add_argument(
        '--repair',
        action='store_true',
        help='close holes of the mesh, remove double faces, turn normals outwards',
    )
    p.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='setting of the planner in SI, as of waam plan --set (adaptive levels, leads, edges, overhang ...)',
    )


def _add_process(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--material',
        default=DEFAULT_MATERIAL,
        help='key of the material table (default %(default)s)',
    )
    add_loop_mode(p)
    p.add_argument('--layer-height', type=float, default=0.0, metavar='MM')
    p.add_argument('--bead-width', type=float, default=0.0, metavar='MM')
    p.add_argument(
        '--k-gain',
        type=float,
        default=float('nan'),
        help=f'authority of the speed correction, 0..{K_GAIN_MAX:g}',
    )
    p.add_argument('--tolerance', type=float, default=0.2, metavar='MM')
    p.add_argument(
        '--wire-left',
        type=float,
        default=0.0,
        metavar='M',
        help='wire on the spool, checked against the plan',
    )


def _add_bookkeeping(p: argparse.ArgumentParser) -> None:
    p.add_argument('--name', default='', help='short name in the folder of the job')
    p.add_argument('--jobs', type=Path, help='where job folders go (default: jobs/)')
    p.add_argument('--operator', default='', metavar='NAME', help='who answers for the job')
    _add_consumables(p)
    p.add_argument(
        '--fresh',
        action='store_true',
        help='start without what former jobs of this cell have taught, and keep nothing of this one',
    )
    _add_ignore(p)
    p.add_argument(
        '--note',
        action='append',
        default=[],
        metavar='KEY=VALUE',
        help='kept with the job',
    )


def _add_ignore(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--ignore-calibration',
        action='store_true',
        help='run although a calibration result refuses it (waam calibrate status)',
    )


def _add_consumables(p: argparse.ArgumentParser) -> None:
    """The report asks for both, and names what is missing."""
    p.add_argument('--wire-lot', default='', metavar='LOT', help='from the spool')
    p.add_argument('--gas', default='', metavar='TEXT', help='kind, bottle')


def _register_resume(job: argparse._SubParsersAction) -> None:
    p = job.add_parser(
        'resume',
        help='go on: with a paused job, or with an interrupted one after a crash or a power cut',
        description='Without a folder: resumes the job that is paused; when none is running, the newest interrupted '
        'job. An interrupted job is scanned again first, compared with its checkpoint, and goes on '
        'at the first bead that is not done.',
    )
    add_run(p)
    p.add_argument('folder', type=Path, nargs='?', help='job folder (default: jobs/latest)')
    p.add_argument('--operator', default='', metavar='NAME', help='who answers for it from here on')
    _add_consumables(p)
    _add_ignore(p)
    p.add_argument(
        '--note', action='append', default=[], metavar='KEY=VALUE', help='kept with the job'
    )
    p.add_argument(
        '--wire-left',
        type=float,
        default=0.0,
        metavar='M',
        help='wire on the spool now, when it was changed; else what the job has used so far is subtracted',
    )
    p.set_defaults(run_command=cmd_job_resume)


def _register_steering(job: argparse._SubParsersAction) -> None:
    for verb, text in (
        ('rescan', 'scan again before the next layer'),
        ('skip-layer', 'leave the next layer out'),
    ):
        p = job.add_parser(verb, help=text)
        add_run(p)
        p.set_defaults(run_command=cmd_job_adjust, code=verb.upper().replace('-', '_'), value=0.0)
    p = job.add_parser('gain', help='authority of the speed correction, from the next layer on')
    add_run(p)
    p.add_argument(
        'value', type=float, help=f'0..{K_GAIN_MAX:g}; nan = that of the correction server'
    )
    p.set_defaults(run_command=cmd_job_adjust, code='SET_K_GAIN')
    p = job.add_parser(
        'feed',
        help='overrides while running: travel speed and wire feed, at once',
        description='Factors on the programmed travel speed and wire feed, in force at once. What is not given stays '
        'as it is: with --speed alone the wire goes on as before, so slower means more metal.',
    )
    add_run(p)
    for name, (low, high) in (('speed', SPEED_FACTOR), ('wire', WIRE_FACTOR)):
        p.add_argument(
            f'--{name}',
            type=float,
            default=float('nan'),
            metavar='FACTOR',
            help=f'{low:g}..{high:g}; 1 = as programmed',
        )
    p.set_defaults(run_command=cmd_job_feed)
    for verb, text in (
        ('pause', 'hold the machine; the arc ends properly'),
        ('abort', 'end the job; the arc ends, the queue is dropped'),
    ):
        p = job.add_parser(verb, help=text)
        add_run(p)
        p.set_defaults(run_command=cmd_job_switch, verb=verb)


def cmd_job_run(args: argparse.Namespace) -> int:
    """Exit status as of `jobs.report_result`."""
    from .jobs import run_job

    run, domain = run_and_domain(args)
    return run_job(args, run, domain)


def cmd_job_switch(args: argparse.Namespace) -> int:
    """Pause or abort (`args.verb`). ClientError when the job sequencer refuses."""
    from .client import GraphClient
    from .operate import require_up

    run, domain = run_and_domain(args)
    require_up(run)
    with GraphClient(domain) as client:
        client.trigger(f'job_sequencer/{args.verb}')
    print(f'{args.verb}: accepted')
    return 0


def cmd_job_resume(args: argparse.Namespace) -> int:
    """Goes on with a paused job; otherwise, or with a folder, resumes an interrupted one."""
    from .client import GraphClient
    from .jobs import resume_job
    from .operate import require_up

    run, domain = run_and_domain(args)
    require_up(run)
    if args.folder is None:
        with GraphClient(domain) as client:
            if client.resume():
                print('resume: accepted')
                return 0
    return resume_job(args, run, domain)


def cmd_job_feed(args: argparse.Namespace) -> int:
    """Overrides travel speed and wire feed at once; prints the factors that are in force."""
    from .jobs import override
    from .operate import require_up

    run, domain = run_and_domain(args)
    require_up(run)
    speed, wire = override(args.speed, args.wire, domain)
    print(f'in force: travel speed x {speed:g}, wire feed x {wire:g}')
    return 0


def cmd_job_adjust(args: argparse.Namespace) -> int:
    """Gain, rescan or skip of the running job. ClientError when it is refused."""
    from .jobs import adjust_job
    from .operate import require_up

    run, domain = run_and_domain(args)
    require_up(run)
    adjust_job(args.code, args.value, domain)
    print('accepted; in force from the next layer on')
    return 0
