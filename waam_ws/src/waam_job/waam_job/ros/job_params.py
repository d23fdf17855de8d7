"""Parameters of the node job_sequencer."""

from __future__ import annotations

from dataclasses import dataclass

from waam_node.params import param
from waam_process.operating import PLATE_ZERO

from ..run.settings import Settings


@dataclass(frozen=True)
class JobParams:
    """Parameters of job_sequencer."""

    lease_nodes: tuple = param(
        (), 'nodes whose heartbeat the arc lease needs; empty = only the bridge'
    )
    jobs_dir: str = param('jobs', 'folder for jobs when the goal names none')
    job_pointer: str = param('', 'file that always holds the path of the newest job; empty = none')
    cell: str = param(
        '',
        'name of the cell under which jobs keep what they teach (docs/job.md); empty = the '
        "controller's, 'simulated' for a simulated cell",
    )
    shop_cell: str = param(
        '',
        'name of the cell among several (waam up --name), kept with every job; empty = the first one',
    )
    cell_file: str = param(
        '',
        'file of the cell, which the machine must be like when a job starts and of which the job keeps a copy '
        '(waam up fills it in); empty = none',
    )
    work_offset: tuple = param((0.100, 0.080, 0.020), 'work zero (G54) in machine coordinates', 'm')
    plate_zero: tuple = param(
        PLATE_ZERO,
        'mode build: work zero seen from the corner of the clamped plate',
        'm',
    )
    chuck_steps_per_turn: float = param(
        0.0,
        'of the motor of a chuck that turns shafts in place of the X axis, by which a job tells the controller the '
        'steps per mm of its shaft; 0 = X is a straight axis',
        '',
        0.0,
        1e6,
    )
    resolution: float = param(0.5e-3, 'edge of a grid cell of the maps', 'm', 1e-4, 5e-3)
    margin: float = param(5e-3, 'map beyond the part on every side', 'm', 0.0, 0.1)
    follow_reach: float = param(
        3e-3, 'smoothing of the surface that the torch height follows', 'm', 5e-4, 2e-2
    )
    cooling_timeout: float = param(1800.0, 'longest interpass wait', 's', 1.0, 86400.0)
    scan_max_age: float = param(
        900.0, 'a layer is not laid on an older map: it is scanned again; 0 = any age', 's', 0.0
    )
    scan_changed_only: bool = param(
        False,
        'the pass after a layer covers only what it has changed, as long as the surface beside it stays where it '
        'was; the rest of the map is kept',
    )
    cold_metal: float = param(
        2e-4,
        'metal less per kelvin that a part is colder than when its layer was interrupted: beads are higher',
        '1/K',
        0.0,
        1e-3,
    )
    restart_metal: float = param(
        0.8,
        'share of its metal that an interrupted path gets over the first bead width after its restart: '
        'metal piles up where an arc starts',
        '',
        0.3,
        1.0,
    )
    calibration_max_age: float = param(
        30.0,
        'days after which no job starts on a scanner calibration; 0 = any age, and none needed',
        'd',
        0.0,
        3650.0,
    )
    allow_unbelieved_temperature: bool = param(
        False, 'a real cell goes on although the temperature does not answer to the layers'
    )
    share_in_tolerance: float = param(
        0.95, 'share of the judged area within tolerance for a good verdict', '', 0.5, 1.0
    )
    service_timeout: float = param(
        20.0, 'longest wait for an answer of another node', 's', 1.0, 600.0
    )


SAME = (
    'cell_file', 'chuck_steps_per_turn', 'margin', 'resolution', 'follow_reach', 'cooling_timeout', 'scan_max_age',
    'scan_changed_only', 'cell', 'cold_metal', 'restart_metal', 'allow_unbelieved_temperature', 'share_in_tolerance',
)  # fmt: skip


def settings_of(p: JobParams, simulated: bool) -> Settings:
    """The settings of the runner."""
    return Settings(
        work_offset=tuple(p.work_offset),
        plate_zero=tuple(p.plate_zero),
        calibration_max_days=p.calibration_max_age,
        simulated=simulated,
        lease_nodes=tuple(p.lease_nodes),
        **{name: getattr(p, name) for name in SAME},
    )
