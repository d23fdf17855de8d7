"""What keeps a job from starting: link, controller, temperature, calibration. All of it at once."""

from __future__ import annotations

from waam_process.names import POWER_UP

from ..model.cell import Cell, Heat, Machine
from ..store import calibration, cell_file
from .settings import Settings

CHUCK_OF_REAL_CELL = (
    'a chuck in place of the X axis (chuck.steps_per_turn) is simulated only: what a real one lacks stands in '
    'docs/real_cell.md'
)
ZERO_LIMIT = 2e-5  # m between the zero asked for and the one that the controller reports


def switched_on(machine: Machine) -> bool:
    """The alarm of a controller that was switched on; starting a job acknowledges it."""
    return machine.state == 'ALARM' and machine.fault == POWER_UP


def problems(cell: Cell, settings: Settings) -> list[str]:
    """Everything that is wrong with the cell right now; empty = a job may start."""
    found = [] if cell.now() > 0 else ['no /clock is coming in']
    found += machine_problems(cell.machine(), settings.limits.link_timeout)
    found += heat_problems(cell.heat())
    file = str(cell.parameters().get('scan_fusion', {}).get('calibration') or '')
    days, simulated = settings.calibration_max_days, settings.simulated
    found.append(calibration.problem_today(file, days, simulated))
    found += as_the_file_says(cell, settings).refused
    if settings.chuck_steps_per_turn and not simulated:
        found.append(CHUCK_OF_REAL_CELL)
    return [p for p in found if p]


def as_the_file_says(cell: Cell, settings: Settings) -> cell_file.Compared:
    """The cell file against the parameters of the nodes and this job's own."""
    names = 'work_offset', 'plate_zero', 'chuck_steps_per_turn'
    own = {name: getattr(settings, name) for name in names}
    parameters = {**cell.parameters(), 'job_sequencer': own}
    return cell_file.compared(settings.cell_file, parameters, settings.simulated)


def machine_problems(machine: Machine, link_timeout: float) -> list[str]:
    """Of link and controller; homing and the work zero are the job's own first steps."""
    if not machine.connected:
        return [machine.message or 'no controller is connected']
    if machine.age > link_timeout:
        return ['no telemetry is coming from the controller']
    found = []
    if machine.state != 'IDLE' and not switched_on(machine):
        why = machine.fault_text or 'not idle'
        way = '; see to it, then Reset and Home (panel)' if machine.state == 'ALARM' else ''
        found.append(f'the controller is in {machine.state}: {why}{way}')
    return found


def heat_problems(heat: Heat) -> list[str]:
    """Of pyrometer and thermal_compensator."""
    if not heat.known:
        return ['no temperature is coming in (pyrometer or thermal_compensator silent)']
    if not heat.plausible:
        return [f'temperature is not believed: {"; ".join(heat.reasons) or "no reason"}']
    return []


def spark_problems(machine: Machine, run_id: str, zero: tuple[float, ...]) -> list[str]:
    """What forbids an arc: not homed, not armed for this job, or a work zero other than the one the job has set."""
    found = []
    if not machine.homed:
        found.append('the machine is not homed')
    if machine.armed_job != run_id:
        found.append(f"the controller is armed for '{machine.armed_job or 'no job'}'")
    off = max(abs(a - b) for a, b in zip(machine.work_offset, zero, strict=True))
    if off > ZERO_LIMIT:
        found.append(
            f'the work zero is {[round(v * 1e3, 3) for v in machine.work_offset]} mm in the controller, '
            f'the job has set {[round(v * 1e3, 3) for v in zero]} mm'
        )
    return found
