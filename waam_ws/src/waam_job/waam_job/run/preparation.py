"""Before the first spark: interlocks (all that is wrong at once), record, arming, homing, work zero."""

from __future__ import annotations

from waam_plan.settings import PlanSettings
from waam_process.segment import Point

from ..model.cell import Cell
from ..model.goal import Checked, Code, JobError, planner_fields
from . import readiness
from .motion import Motion
from .settings import Settings

READY_LOOKS = 100  # a tenth of a second apart


class Preparation:
    """Brings the machine into the state in which a job may start."""

    def __init__(self, cell: Cell, motion: Motion, checked: Checked, settings: Settings) -> None:
        self.cell, self.motion, self.checked, self.settings = cell, motion, checked, settings

    def run(self, run_id: str, record_folder: str, custom: tuple[str, ...]) -> None:
        """Record, arming, homing, work zero of a machine that is ready."""
        settings = self.settings
        self._acknowledge_power_up()
        self.cell.record(True, record_folder, custom)
        self.cell.command('ARM', text=run_id, names=settings.lease_nodes)
        self.motion.until(lambda m: m.armed_job == run_id, 10.0, 'the controller did not arm')
        self.motion.home(settings.home_timeout)
        self._set_zero(run_id)
        self.motion.position = self.cell.machine().position
        self.cell.take_sums()
        self.cell.take_track()
        self.cell.take_warnings()

    def _acknowledge_power_up(self) -> None:
        """Starting a job acknowledges that the controller was switched on. Any other alarm is left to a person."""
        if not readiness.switched_on(self.cell.machine()):
            return
        self.cell.command('RESET')
        for _ in range(READY_LOOKS):
            if self.cell.machine().state == 'IDLE':
                return
            self.cell.wait(0.1)
        raise JobError(Code.MACHINE_NOT_READY, 'the controller stays in ALARM after RESET')

    def _set_zero(self, run_id: str) -> None:
        zero = self.work_zero()
        self.cell.command('SET_ZERO', vector=zero)
        self.motion.until(
            lambda m: not readiness.spark_problems(m, run_id, zero),
            10.0,
            'homing, arming and work zero were not all confirmed by the controller',
        )

    def work_zero(self) -> Point:
        """Machine coordinates of the part's lower corner: the clamp's zero, or inside and on top of the plate."""
        if self.checked.goal.mode == 'restore':
            return self.settings.work_offset
        pairs = zip(self.settings.work_offset, self.settings.plate_zero, strict=True)
        return tuple(a + b for a, b in pairs)

    def plan_settings(self) -> PlanSettings:
        """What the planner needs of goal, material and machine."""
        machine, zero = self.cell.machine(), self.work_zero()
        low, high = (
            tuple(a - b for a, b in zip(limit, zero, strict=True))
            for limit in (machine.limit_min, machine.limit_max)
        )
        return PlanSettings(
            machine_min=low,
            machine_max=high,
            grid=self.settings.resolution,
            **planner_fields(self.checked.goal, self.checked.material),
        )

    def reach_known(self) -> bool:
        """Whether the controller has said how far the machine reaches."""
        machine = self.cell.machine()
        pairs = zip(machine.limit_min, machine.limit_max, strict=True)
        return all(low < high for low, high in pairs)

    def not_ready(self) -> list[str]:
        """Everything that is wrong with the cell. What may only be late (a node just started) gets a few seconds."""
        problems: list[str] = []
        for _ in range(READY_LOOKS):
            problems = readiness.problems(self.cell, self.settings)
            if not problems:
                break
            self.cell.wait(0.1)
        return problems

    def check_spark(self, run_id: str) -> None:
        """JobError with everything that would make an arc wrong at this moment."""
        wrong = readiness.spark_problems(self.cell.machine(), run_id, self.work_zero())
        if wrong:
            raise JobError(Code.MACHINE_NOT_READY, f'before the arc: {"; ".join(wrong)}')

    def remarks(self) -> list[str]:
        """What a person should know although the job may start."""
        scan = self.cell.parameters().get('scan_fusion', {})
        heat = self.cell.parameters().get('thermal_compensator', {})
        goal, said = self.checked.goal, []
        if not scan.get('calibration'):
            said.append('the scanner has no calibration file: its age was not checked')
        if not goal.wire_left and not self.settings.simulated:
            said.append('nobody said how much wire is left: it was not checked against the plan')
        report = self.checked.part.report
        said += [f'part repaired: {text}' for text in report.repairs]
        said += [f'part: {report.crossing}'] if report.crossing else []
        named = heat.get('material', goal.material)
        if named != goal.material:
            said.append(f'the interpass limit is that of {named}, the job lays {goal.material}')
        return said
