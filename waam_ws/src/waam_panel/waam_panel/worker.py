"""Slow work in a process of its own, so that a large mesh never holds up the panel: previews and reports. No ROS.

python3 -m waam_panel.worker plan PART ... --out DIR     like `waam plan`, material defaults filled in
python3 -m waam_panel.worker report FOLDER               report.html of a job
python3 -m waam_panel.worker table PART WORN OUT         WORN as it lies in the simulated cell, a height map (.npz)
python3 -m waam_panel.worker program JSON                a look at a program, JSON
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
from pathlib import Path

from .setup_form import JobSetup

PATIENCE_S = 120.0


class WorkError(RuntimeError):
    """The work failed; the text is its last words."""


def plan_arguments(setup: JobSetup, part: Path, as_found: Path | None, out: Path) -> list[str]:
    """The command line of `waam plan` that plans as the job will: the material's layer, bead and speed."""
    from waam_plan.finish import bead_width
    from waam_process.materials import get

    material = get(setup.material)
    height = setup.layer_height_mm or material.layer_height * 1e3
    width = setup.bead_width_mm or bead_width(material.bead_width, setup.finish) * 1e3
    arguments = ['plan', str(part), '--mode', setup.mode, '--layers', str(setup.layers)]
    arguments += ['--layer-height', f'{height:g}', '--bead-width', f'{width:g}']
    arguments += ['--speed', f'{material.speed * 1e3:g}', '--out', str(out)]
    if setup.mode == 'restore':
        arguments += ['--finish', setup.finish, '--set', f'allowance={setup.allowance_mm * 1e-3:g}']
    return arguments + (['--as-found', str(as_found)] if as_found else [])


async def work(arguments: list[str], patience: float = PATIENCE_S) -> str:
    """Runs this module in a child of low priority; its output. Raises WorkError."""
    child = await asyncio.create_subprocess_exec(
        *('nice', '-n', '10', sys.executable, '-m', 'waam_panel.worker', *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env={**os.environ, 'OMP_NUM_THREADS': '1'},
    )
    try:
        out, errors = await asyncio.wait_for(child.communicate(), patience)
    except (TimeoutError, asyncio.CancelledError) as e:
        child.kill()
        await child.wait()
        if isinstance(e, asyncio.CancelledError):
            raise
        raise WorkError(f'gave up after {patience:.0f} s') from None
    if child.returncode:
        lines = errors.decode(errors='replace').strip().splitlines()
        text = lines[-1] if lines else f'ended with {child.returncode}'
        raise WorkError(text.removeprefix('waam plan: '))
    return out.decode(errors='replace')


def _program(text: str) -> int:
    from .program_look import ENDLESS, Asked, look

    data = json.loads(text)
    limits = data['limits']
    asked = Asked(
        Path(data['program']),
        data['dialect'],
        Path(data['nominal']) if data['nominal'] else None,
        data['material'],
        tuple(data['shift']),
        (tuple(limits[:3]), tuple(limits[3:])) if limits else ENDLESS,
    )
    json.dump(look(asked).as_dict(), sys.stdout)
    return 0


def _table(part: str, worn: str, out: str) -> int:
    from waam_plan.mesh.part import load_part
    from waam_plan.mesh.placed import on_table
    from waam_plan.settings import PlanSettings

    try:
        nominal = load_part(part, 1e-3, require_closed=False)
        on_table(nominal, Path(worn), 1e-3, PlanSettings()).heights.save_npz(out)
    except ValueError as e:
        print(e, file=sys.stderr)
        return 2
    return 0


def main(arguments: list[str]) -> int:
    """0; otherwise one line on stderr says why."""
    if arguments[:1] == ['report']:
        from waam_view.report import main as report

        return report(arguments[1:])
    if arguments[:1] == ['table']:
        return _table(*arguments[1:])
    if arguments[:1] == ['program']:
        return _program(arguments[1])
    from waam_plan.cli import register

    parser = argparse.ArgumentParser()
    register(parser.add_subparsers(required=True))
    args = parser.parse_args(arguments)
    return args.run_command(args)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
