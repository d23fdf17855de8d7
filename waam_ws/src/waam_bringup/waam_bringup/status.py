"""waam status: processes, machine, job, as a table."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from waam_process.names import controller_state

from .client import SERVER_S, GraphClient
from .progress import clock, describe
from .run_state import RunState, describe_exit


def print_status(run: Path, state: RunState, domain: int) -> int:
    """0 when everything is alive, 1 when a process died."""
    with GraphClient(domain) as client:
        client.until(lambda: client.machine and client.job, SERVER_S)
        machine, job = client.machine, client.job
    console = Console(highlight=False)
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
    if job is None:
        console.print('job: job_sequencer does not answer')
    else:
        console.print(
            f'job: {job.job_id or "none"} {describe(job)}, {job.progress * 100:.0f} %, left {clock(job.time_left)}'
        )
        if job.message:
            console.print(f'  {job.message}')
    return 1 if state.dead_nodes else 0
