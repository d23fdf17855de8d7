"""`waam job`: run jobs, adjust the running one, resume an interrupted one. What the verbs do: `jobs`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from waam_job.cli_program import (
    FINISH_HELP,
    FINISHES,
    PART_HELP,
    add_loop_mode,
    add_program,
    add_shaft,
)
from waam_job.model.limits import K_GAIN_MAX
from waam_process.cli_options import Options, Verbs, add_options, add_verb
from waam_process.operating import DEFAULT_MATERIAL, SPEED_FACTOR, WIRE_FACTOR

from .cli_common import add_run, late
from .cli_graph import STATUS, status

STEERING = """\
while a job runs, from any other terminal (or the panel):
  waam job pause                   the arc ends properly, the machine holds; waam job resume goes on
  waam job rescan                  measure again before the next layer
  waam job gain 0.15               less authority for the correction, from the next layer on
  waam job feed --speed 0.9        travel speed and wire feed of what is being laid, at once
  waam job skip-layer              leave the next layer out
  waam job abort                   safe end; waam job resume FOLDER goes on with it later

after a crash or a power cut: waam up, then waam job resume"""
EXAMPLES = """\
examples:
  waam job run jaw_nominal.stl --as-found jaw_worn.stl --material er70s-6
  waam job run vase.stl --mode build --layers 3 --loop-mode monitor
  waam job run bracket.3mf --mode build --repair --set levels=adaptive --set overhang=flag
  waam job run worn.npz --shaft 40 --ends 14                      a shaft in the chuck of a cell that has one
  waam job run vase.gcode --dialect slicer --nominal vase.stl     the path of another slicer, corrected
  waam job run wall.nc --dialect mywelder.yaml                    without a nominal part: monitor

exit status: 0 done, 1 the job failed, 2 it was refused, 130 cancelled with Ctrl-C"""
RESUME = """\
Without a folder: resumes the job that is paused; when none is running, the newest interrupted job. An interrupted job
is scanned again first, compared with its checkpoint, and goes on at the first bead that is not done."""
FEED = """\
Factors on the programmed travel speed and wire feed, in force at once. What is not given stays as it is: with --speed
alone the wire goes on as before, so slower means more metal."""
RUN: Options = (
    ('--mode', str, 'restore: nominal minus scan (default for a part); build: onto a flat plate (default for a program '
     'without --as-found)', None, {'choices': ('restore', 'build')}),
    ('--as-found', Path, 'simulated cell: mesh of the worn part that lies on the table'),
    ('--scale', 1e-3, 'metres per unit of the file (default 0.001: millimetres)'),
    ('--finish', str, FINISH_HELP, None, {'choices': FINISHES}),
    ('--allowance', 0.0, 'metal left on top of the nominal part for machining', 'MM'),
    ('--passes', 1, '2 = half of the layers, then plan again from the scan (a posteriori)'),
    ('--strategy', '', 'how layers are filled (waam plan --help); default: chosen'),
    ('--layers', 0, 'at most so many layers; 0 = as many as needed'),
    ('--repair', False, 'close holes of the mesh, remove double faces, turn normals outwards'),
    ('--set', [], 'setting of the planner in SI, as of waam plan --set (adaptive levels, leads, edges, overhang ...)',
     'NAME=VALUE'),
    ('--material', '', f'key of the material table (default: that of the cell file, else {DEFAULT_MATERIAL})'),
    ('--layer-height', 0.0, 'default: that of the material', 'MM'),
    ('--bead-width', 0.0, 'default: that of the material', 'MM'),
    ('--k-gain', math.nan, f'authority of the speed correction, 0..{K_GAIN_MAX:g}'),
    ('--tolerance', 0.2, 'default %(default)s', 'MM'),
    ('--wire-left', 0.0, 'wire on the spool, checked against the plan', 'M'),
    ('--name', '', 'short name in the folder of the job'),
    ('--jobs', Path, 'where job folders go (default: jobs/)'),
    ('--fresh', False, 'start without what former jobs of this cell have taught, and keep nothing of this one'),
)  # fmt: skip
RECORD: Options = (  # of a job that begins, and of one that goes on; the report names what is missing
    ('--operator', '', 'who answers for the job from here on', 'NAME'),
    ('--wire-lot', '', 'from the spool', 'LOT'), ('--gas', '', 'kind, bottle', 'TEXT'),
    ('--note', [], 'kept with the job', 'KEY=VALUE'),
    ('--ignore-calibration', False, 'run although a calibration result refuses it (waam calibrate status)'),
)  # fmt: skip


def register_job(commands: Verbs) -> None:
    """Adds `waam job` and its verbs."""
    parser = add_verb(commands, 'job', 'run and steer jobs', description=None, epilog=STEERING)
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)

    def add(
        name: str,
        run: str,
        text: str,
        *rows: Any,
        more: dict[str, Any] | None = None,
        **settings: Any,
    ) -> Any:
        """A verb, and the function of `jobs` that it calls; more: what that is told besides."""
        p = add_verb(verbs, name, text, **settings)
        add_run(p)
        add_options(p, *rows)
        p.set_defaults(run_command=late('jobs', run), **(more or {}))
        return p

    add_run_options(
        add('run', 'run_job', 'run a job on the graph that is up and follow it', epilog=EXAMPLES)
    )
    add(
        'resume', 'go_on', 'go on: with a paused job, or with an interrupted one after a crash or a power cut',
        ('folder', Path, 'job folder (default: jobs/latest)', None, {'nargs': '?'}), *RECORD,
        ('--wire-left', 0.0, 'wire on the spool now, when it was changed; else what the job has used so far is '
         'subtracted', 'M'), description=RESUME,
    )  # fmt: skip
    add('status', '', 'what the running job does', *STATUS).set_defaults(run_command=status)
    for name, text in (
        ('rescan', 'scan again before the next layer'),
        ('skip-layer', 'leave the next layer out'),
    ):
        add(name, 'adjust', text, more={'code': name.upper().replace('-', '_'), 'value': 0.0})
    value = f'0..{K_GAIN_MAX:g}; nan = that of the correction server'
    text = 'authority of the speed correction, from the next layer on'
    add('gain', 'adjust', text, ('value', float, value), more={'code': 'SET_K_GAIN'})
    factors = [
        (f'--{name}', math.nan, f'{low:g}..{high:g}; 1 = as programmed', 'FACTOR')
        for name, (low, high) in (('speed', SPEED_FACTOR), ('wire', WIRE_FACTOR))
    ]
    text = 'overrides while running: travel speed and wire feed, at once'
    add('feed', 'feed', text, *factors, description=FEED)
    add('pause', 'switch', 'hold the machine; the arc ends properly')
    add('abort', 'switch', 'end the job; the arc ends, the queue is dropped')


def add_run_options(p: argparse.ArgumentParser) -> None:
    """What a job is told."""
    add_options(p, ('part', Path, PART_HELP))
    add_program(p)
    add_shaft(p)
    add_options(p, *RUN)
    add_loop_mode(p)
    add_options(p, *RECORD)
