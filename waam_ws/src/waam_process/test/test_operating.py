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


def test_the_plate_grows_with_the_build_and_keeps_its_rim():
    assert operating.build_plate((0.1, 0.05, 0.3)) == operating.BUILD_PLATE
    assert operating.build_plate((0.2, 0.16)) == pytest.approx(operating.BUILD_PLATE)
    assert operating.build_plate((0.25, 0.05)) == pytest.approx((0.290, 0.200, 0.010))
    assert operating.build_plate((0.1, 0.2), (0.05, 0.03, 0.01)) == pytest.approx(
        (0.24, 0.26, 0.01)
    )
