"""Before the first arc: interlocks (all problems at once), recording, arming, homing, work zero."""

from __future__ import annotations

from waam_process.units import to_mm

from ..model.goal import Code, JobError
from . import readiness, work_frame
from .context import JobContext

LOOK_S = 0.1
READY_LOOKS = 100  # that a node which has just started gets, LOOK_S apart
AFTER_ZERO_S = 0.05  # of ROS time: what the two stamps may differ by
CONFIRM_S = 10.0  # that the controller may take to confirm a command


class Preparation:
    """Brings the machine into the state in which a job may start."""

    def __init__(self, context: JobContext) -> None:
        self.cell, self.motion, self.settings = context.cell, context.motion, context.settings
        self.checked, self.run_id, self.zero = context.checked, context.run_id, context.work_zero

    def run(self, record_folder: str, custom: tuple[str, ...]) -> None:
        """Record, arming, homing, work zero of a machine that is ready. custom: key=value kept with the record."""
        self._acknowledge_power_up()
        self.cell.record(True, record_folder, custom)
        self._set_chuck()
        self.cell.command('ARM', text=self.run_id, names=self.settings.lease_nodes)
        self.motion.until(
            lambda m: m.armed_job == self.run_id, CONFIRM_S, 'the controller did not arm'
        )
        self.motion.home(self.settings.home_timeout)
        self._set_zero()
        self.motion.position = work_frame.reached(self.cell.machine(), self.zero)
        self.cell.take_sums()
        self.cell.take_track()
        self.cell.take_warnings()

    def _set_chuck(self) -> None:
        """Steps per mm of the unrolled shaft: those of a turn over the length of a turn. New ones lose homing, and are
        taken only before the controller is armed."""
        shaft, steps = self.checked.shaft, self.settings.chuck_steps_per_turn
        if shaft is None or not steps:
            return
        self.cell.command('CONFIGURE', text='steps_per_mm_x', value=steps / to_mm(shaft.period))

    def _acknowledge_power_up(self) -> None:
        """Starting a job acknowledges that the controller was switched on. Any other alarm is left to a person."""
        if not readiness.switched_on(self.cell.machine()):
            return
        self.cell.command('RESET')
        for _ in range(READY_LOOKS):
            if self.cell.machine().state == 'IDLE':
                return
            self.cell.wait(LOOK_S)
        raise JobError(Code.MACHINE_NOT_READY, 'the controller stays in ALARM after RESET')

    def _set_zero(self) -> None:
        self.cell.command('SET_ZERO', vector=self.zero)
        self.motion.until(
            lambda m: not readiness.spark_problems(m, self.run_id, self.zero),
            CONFIRM_S,
            'homing, arming and work zero were not all confirmed by the controller',
        )
        # the position comes by another topic: one from before is still counted from the old zero
        since = self.cell.machine().state_at + AFTER_ZERO_S
        self.motion.until(
            lambda m: m.position_at > since, CONFIRM_S, 'no telemetry came after the work zero'
        )

    def not_ready(self) -> list[str]:
        """Everything that is wrong with the cell. Nodes that have just started get a few seconds; a temperature alone
        gets the pyrometer's patience, for it steps when a hot part is changed for a cold one."""
        problems: list[str] = []
        for look in range(max(READY_LOOKS, round(self.settings.pyrometer_patience / LOOK_S))):
            problems = readiness.problems(self.cell, self.settings)
            only_heat = problems == readiness.heat_problems(self.cell.heat())
            if not problems or (look >= READY_LOOKS and not only_heat):
                break
            self.cell.wait(LOOK_S)
        return problems

    def check_spark(self) -> None:
        """JobError with everything that would make an arc wrong at this moment."""
        wrong = readiness.spark_problems(self.cell.machine(), self.run_id, self.zero)
        if wrong:
            raise JobError(Code.MACHINE_NOT_READY, f'before the arc: {"; ".join(wrong)}')

    def remarks(self) -> list[str]:
        """What a person should know although the job may start."""
        scan = self.cell.parameters().get('scan_fusion', {})
        goal, said = self.checked.goal, []
        if not scan.get('calibration'):
            said.append('the scanner has no calibration file: its age was not checked')
        if not goal.wire_left and not self.settings.simulated:
            said.append('nobody said how much wire is left: it was not checked against the plan')
        said += readiness.as_the_file_says(self.cell, self.settings).remarks
        said += self.checked.remarks
        if self.checked.part is not None:
            report = self.checked.part.report
            said += [f'part repaired: {text}' for text in report.repairs]
            said += [f'part: {report.crossing}'] if report.crossing else []
        return said
