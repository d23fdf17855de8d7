"""From the scan to the plan of a pass."""

from __future__ import annotations

from waam_plan.build import plan_build
from waam_plan.plan import Plan
from waam_plan.restore import plan_restoration
from waam_plan.settings import PlanSettings
from waam_plan.surface import top_surface
from waam_process.grid import HeightGrid

from .goal import Checked, Code, JobError


def make_plan(checked: Checked, settings: PlanSettings, found: HeightGrid, laid: int) -> Plan:
    """What is to be laid on the surface `found`, when `laid` layers of the job lie there already.

    JobError when it cannot be planned, or when the spool does not hold the wire for it.
    """
    part, goal = checked.part, checked.goal
    try:
        if goal.mode == 'build':
            plan = plan_build(part, settings, goal.layers, found.spec)
        else:
            corner = tuple(-float(v) for v in part.bounds[0])
            nominal = top_surface(part.mesh, found.spec, corner)
            wanted = max(1, goal.layers - laid) if goal.layers else 0
            plan = plan_restoration(found, nominal, settings, wanted)
    except ValueError as e:
        raise JobError(Code.PLAN_FAILED, str(e)) from None
    if goal.wire_left and plan.wire > goal.wire_left:
        raise JobError(
            Code.MACHINE_NOT_READY,
            f'the plan needs {plan.wire:.1f} m of wire, {goal.wire_left:.1f} m are on the spool',
        )
    return plan
