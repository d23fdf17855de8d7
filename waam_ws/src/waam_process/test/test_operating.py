"""The limits are those of the message and of the controller."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from waam_process import operating

SOURCES = Path(__file__).parents[2]
MESSAGE = SOURCES / 'waam_msgs' / 'msg' / 'Override.msg'
CONTROLLER = SOURCES / 'waam_firmware' / 'core' / 'machine' / 'waam_orders.c'


@pytest.mark.parametrize(
    'field,limits',
    [('speed_factor', operating.SPEED_FACTOR), ('wire_factor', operating.WIRE_FACTOR)],
)
def test_factors_have_the_range_that_the_message_tells(field, limits):
    line = re.search(rf'^float64 {field}\s+# ([\d.]+?)\.\.([\d.]+)$', MESSAGE.read_text(), re.M)
    assert line and tuple(map(float, line.groups())) == limits


def test_the_controller_takes_the_same_range():
    check = r'v\[0\] < (\d+) \|\| v\[0\] > (\d+) \|\| v\[1\] < (\d+) \|\| v\[1\] > (\d+)'
    found = re.search(check, CONTROLLER.read_text())
    permille = [1000 * x for x in operating.SPEED_FACTOR + operating.WIRE_FACTOR]
    assert found and [float(x) for x in found.groups()] == permille
