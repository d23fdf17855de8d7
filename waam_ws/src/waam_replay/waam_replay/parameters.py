"""Parameters for a replay: those that the nodes had when the job was recorded, and what the user sets otherwise."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import yaml

from waam_adapt.feed.params import FeedParams
from waam_adapt.laws.corrector import CorrectionParams
from waam_node.params import ParameterError, from_dict, hint, param
from waam_process.loop_mode import LoopMode
from waam_scan.fusion_params import FusionParams


@dataclass(frozen=True)
class JobParams:
    """What the job requests from the nodes."""

    k_gain: float = param(
        math.nan, 'authority over speed that the job asks for; NaN = as recorded', '', 0.0, 0.9
    )
    apply_correction: bool = param(True, 'whether the setpoints follow psi (closed loop)')
    heat_factor: float = param(math.nan, 'of eq 2.19; NaN = as recorded', '', 0.1, 1.0)


NODES = {
    'scan_fusion': FusionParams, 'correction_server': CorrectionParams, 'feed_forward': FeedParams, 'job': JobParams,
}  # fmt: skip


@dataclass(frozen=True)
class Parameters:
    """One instance of each node's parameters; `notes`: recorded values that could not be used."""

    scan_fusion: FusionParams
    correction_server: CorrectionParams
    feed_forward: FeedParams
    job: JobParams
    changed: dict[str, Any]
    notes: tuple[str, ...] = ()


def parse(settings: list[str]) -> dict[str, dict[str, Any]]:
    """`node.name=value` texts by node. ParameterError names what is unknown."""
    found: dict[str, dict[str, Any]] = {name: {} for name in NODES}
    for text in settings:
        key, separator, value = text.partition('=')
        node, dot, name = key.strip().partition('.')
        if not separator or not dot:
            raise ParameterError(f"'{text}' is not of the form node.parameter=value")
        if node not in NODES:
            raise ParameterError(f"unknown node '{node}' in '{text}'{hint(node, NODES)}")
        known = [f.name for f in dataclasses.fields(NODES[node])]
        if name not in known:
            raise ParameterError(f"unknown parameter '{node}.{name}'{hint(name, known)}")
        found[node][name] = yaml.safe_load(value)
    return found


def effective(
    recorded: dict[str, dict[str, Any]], settings: list[str], loop_mode: str = ''
) -> Parameters:
    """Recorded parameters (by node), changed by `settings`. ParameterError names what is unknown or out of range."""
    wanted = parse(settings)
    notes: list[str] = []
    made: dict[str, Any] = {}
    for node, kind in NODES.items():
        base = _recorded(node, kind, recorded, notes)
        if node == 'job':
            base = {'apply_correction': loop_mode in (LoopMode.CLOSED_LOOP, '')}
        made[node] = from_dict(kind, {**base, **wanted[node]}, node)
    changed = {f'{n}.{k}': v for n, values in wanted.items() for k, v in values.items()}
    return Parameters(**made, changed=changed, notes=tuple(notes))


def _recorded(
    node: str, kind: type, recorded: dict[str, dict[str, Any]], notes: list[str]
) -> dict[str, Any]:
    if node == 'job':
        return {}
    if node not in recorded:
        notes.append(f'the parameters of {node} are not in the record: its defaults are used')
        return {}
    known = {f.name for f in dataclasses.fields(kind)}
    values = recorded[node]
    allowed = ('use_sim_time', 'start_type_description_service')
    if strange := sorted(set(values) - known - set(allowed)):
        notes.append(f'{node} was recorded by another version: {", ".join(strange)} left out')
    return {k: v for k, v in values.items() if k in known}
