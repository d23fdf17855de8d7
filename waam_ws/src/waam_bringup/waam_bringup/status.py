"""waam status, waam job status: processes, machine, job, as a table or as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from waam_msgs.msg import MachineState
from waam_process.names import controller_state

from .client import SERVER_S, GraphClient
from .progress import NAMES, clock, describe
from .run_state import RunState, describe_exit


def print_status(run: Path, state: RunState, domain: int, as_json: bool, job_only: bool) -> int:
    """0 when everything is alive, 1 when a process died. With `job_only` nothing but the job is shown."""
    with GraphClient(domain) as client:
        client.until(lambda: (client.machine or job_only) and client.job, SERVER_S)
        machine, job = client.machine, client.job
    status = 1 if state.dead_nodes else 0
    if as_json:
        told = None if job is None else plain(job) | {'state': NAMES[job.state]}
        if not job_only:
            state_name = None if machine is None else {'state': controller_state(machine.state)}
            board = state_name and plain(machine) | state_name
            told = {'run': str(run), 'graph': asdict(state), 'machine': board, 'job': told}
        print(json.dumps(told))
        return status
    console = Console(highlight=False)
    if not job_only:
        _print_graph(console, run, state, domain, machine)
    if job is None:
        console.print('job: job_sequencer does not answer')
    else:
        console.print(
            f'job: {job.job_id or "none"} {describe(job)}, {job.progress * 100:.0f} %, left {clock(job.time_left)}'
        )
        if job.message:
            console.print(f'  {job.message}')
    return status


def _print_graph(
    console: Console, run: Path, state: RunState, domain: int, machine: MachineState | None
) -> None:
    """Processes and machine."""
    table = Table(title=f'graph in {run}, ROS_DOMAIN_ID={domain}, {state.phase}')
    for column in ('process', 'pid', 'state'):
        table.add_column(column)
    for name, node in state.nodes.items():
        how = 'running' if node.exit_code is None else f'[red]{describe_exit(node.exit_code)}[/red]'
        if node.restarts:
            how += f', started again {node.restarts} x: {node.reason}'
        table.add_row(name, str(node.pid), how)
    console.print(table)
    if state.preset:
        console.print(f'cell: simulated, preset {state.preset}')
    if machine is None:
        console.print('machine: the bridge does not answer')
    elif not machine.connected:
        console.print(f'machine: not connected. {machine.message}')
    else:
        console.print(
            f'machine: {controller_state(machine.state)}, {"homed" if machine.homed else "not homed"}, '
            f'arc {"on" if machine.arc_on else "off"}, {machine.identity} {machine.firmware_version} on {machine.port}'
        )
        if machine.fault_text:
            console.print(f'  fault {machine.fault}: {machine.fault_text}')


def plain(message: Any) -> Any:
    """A message as dictionaries and lists, without its header; None for none, and for what is NaN."""
    if isinstance(message, float) and math.isnan(message):
        return None
    if hasattr(message, 'get_fields_and_field_types'):
        names: Mapping[str, str] = message.get_fields_and_field_types()
        return {n: plain(getattr(message, n)) for n in names if n != 'header'}
    if isinstance(message, list | tuple):
        return [plain(v) for v in message]
    return message
