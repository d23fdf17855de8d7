"""What `waam commission` does in each step, by its name, and what becomes of one that ends in the midst."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace

from waam_calibrate.commission import Outcome
from waam_calibrate.evidence import EvidenceError
from waam_msgs.srv import Command

from .client import ClientError
from .commission_arc import arc, bead, lead, part
from .commission_axes import directions, gas, homing, resonance, skew, steps, wheel
from .commission_scanner import scanner
from .commission_still import (
    estop,
    limits,
    link,
    pyrometer,
    rest,
    settings,
    signals,
    temperature,
)
from .commission_visit import Visit

STEPS_BY_NAME: dict[str, Callable[[Visit], Outcome]] = {
    'link': link, 'settings': settings, 'estop': estop, 'limits': limits, 'rest': rest, 'signals': signals,
    'temperature': temperature, 'directions': directions, 'homing': homing, 'gas': gas, 'steps': steps,
    'skew': skew, 'wire': wheel, 'pyrometer': pyrometer, 'resonance': resonance, 'scanner': scanner, 'arc': arc,
    'lead': lead, 'bead': bead, 'part': part,
}  # fmt: skip


def run(visit: Visit) -> Outcome:
    """One step. What the machine refuses in the midst of it is a failure of the step; the machine is stopped then."""
    try:
        found = STEPS_BY_NAME[visit.step.name](visit)
    except EvidenceError as e:
        found = Outcome(False, str(e), (), 'measure again')
    except ClientError as e:
        _stop(visit)
        found = Outcome(False, str(e), (), 'waam status')
    except BaseException:
        _stop(visit)
        raise
    return replace(
        found, answers=dict(visit.answers), pictures=tuple(visit.pictures), job=visit.job
    )


def _stop(visit: Visit) -> None:
    if visit.step.moves:
        with contextlib.suppress(ClientError):
            visit.cell.order(Command.Request.STOP)
