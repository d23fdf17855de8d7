"""The settings of the standoff control: parameters of the bridge, read and set while it runs."""

from __future__ import annotations

import math
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python

from waam_node.node import CallError, WaamNode, call

from .operations import Refused, StandoffSettings

PATIENCE_S = 5.0
NAMES = (
    'standoff_source', 'standoff_law', 'standoff_set', 'standoff_up', 'standoff_down', 'standoff_arc_wander',
)  # fmt: skip
# what fits one source only: with another one it is what fits that
OF_SOURCE = (
    'standoff_dead_band', 'standoff_lead', 'standoff_jump', 'standoff_kp', 'standoff_ki',
)  # fmt: skip


class BridgeStandoff:
    """Both methods block; Refused with the bridge's words."""

    def __init__(self, node: WaamNode) -> None:
        self._get = node.create_client(GetParameters, 'bridge/get_parameters')
        self._set = node.create_client(SetParametersAtomically, 'bridge/set_parameters_atomically')

    def read(self) -> StandoffSettings:
        """Those of the bridge."""
        values = self._call(self._get, GetParameters.Request(names=list(NAMES))).values
        if len(values) != len(NAMES):
            raise Refused('this bridge has no standoff control')
        return StandoffSettings(*(parameter_value_to_python(v) for v in values))

    def write(self, wanted: StandoffSettings) -> str:
        """All together or none. What only fits the source before goes back to what fits the new one."""
        values: dict[str, Any] = dict(zip(NAMES, vars(wanted).values(), strict=True))
        if self.read().source != wanted.source:
            values |= dict.fromkeys(OF_SOURCE, math.nan)
        messages = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        request = SetParametersAtomically.Request(parameters=messages)
        result = self._call(self._set, request).result
        if not result.successful:
            raise Refused(result.reason)
        return (
            f'standoff control: {wanted.source}'
            if wanted.source != 'none'
            else 'standoff control: off'
        )

    def _call(self, client: Any, request: Any) -> Any:
        try:
            return call(client, request, PATIENCE_S)
        except CallError as e:
            raise Refused(str(e)) from None
