"""Before the first spark: interlocks (all that is wrong at once), record, arming, homing, work zero."""

from __future__ import annotations

from waam_plan.settings import PlanSettings
from waam_process.segment import Point

from .cell import Cell
from .goal import Checked, Code, JobError
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
        self.cell.record(True, record_folder, custom)
        self.cell.command('ARM', text=run_id, names=settings.lease_nodes)
        self.motion.until(lambda m: m.armed_job == run_id, 10.0, 'the controller did not arm')
        self.motion.home(settings.home_timeout)
        self.cell.command('SET_ZERO', vector=self.work_zero())
        self.cell.wait(0.1)
        self.motion.position = self.cell.machine().position
        self.cell.take_sums()
        self.cell.take_track()

    def work_zero(self) -> Point:
        """Machine coordinates of the part's lower corner: the clamp's zero, or inside and on top of the plate."""
        if self.checked.goal.mode == 'restore':
            return self.settings.work_offset
        pairs = zip(self.settings.work_offset, self.settings.plate_zero, strict=True)
        return tuple(a + b for a, b in pairs)

    def plan_settings(self) -> PlanSettings:
        """What the planner needs of goal, material and machine."""
        material, goal = self.checked.material, self.checked.goal
        machine, zero = self.cell.machine(), self.work_zero()
        low, high = (
            tuple(a - b for a, b in zip(limit, zero, strict=True))
            for limit in (machine.limit_min, machine.limit_max)
        )
        return PlanSettings(
            machine_min=low,
            machine_max=high,
            layer_height=goal.layer_height or material.layer_height,
            bead_width=goal.bead_width or material.bead_width,
            speed=material.speed,
            grid=self.settings.resolution,
            allowance=goal.allowance,
            strategy=goal.strategy or PlanSettings.strategy,
        )

    def check_ready(self) -> None:
        """JobError with everything that is wrong. What may only be late (a node just started) gets a few seconds."""
        problems: list[str] = []
        for _ in range(READY_LOOKS):
            problems = self._problems()
            if not problems:
                return
            self.cell.wait(0.1)
        raise JobError(Code.MACHINE_NOT_READY, '; '.join(problems))

    def _problems(self) -> list[str]:
        machine = self.cell.machine()
        problems = [] if self.cell.now() > 0 else ['no /clock is coming in']
        if not machine.connected:
            problems.append(machine.message or 'no controller is connected')
        elif machine.age > self.settings.limits.link_timeout:
            problems.append('no telemetry is coming from the controller')
        elif machine.state != 'IDLE':
            problems.append(
                f'the controller is in {machine.state}: {machine.fault_text or "not idle"}'
            )
        heat = self.cell.heat()
        if not heat.known:
            problems.append('no temperature is coming in (pyrometer or thermal_compensator silent)')
        elif not heat.plausible:
            problems.append(
                f'temperature is not believed: {"; ".join(heat.reasons) or "no reason"}'
            )
        return problems
