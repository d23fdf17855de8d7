"""kill -9 of the host, of the controller, and a pulled terminal, in the middle of a bead: the arc is off in time.

`test_bridge_virtual_controller.py` kills the real node.
"""

import pytest
from bridge_harness import virtual_controller
from bridge_kill import KINDS, LEASE_US, Scene


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    scene = Scene(tmp_path_factory.mktemp('kill'), virtual_controller())
    yield scene
    scene.close()


@pytest.mark.parametrize('kind', KINDS)
def test_the_arc_is_off_within_the_lease(scene, kind):
    age = scene.kill(kind)
    assert 0.0 <= age <= LEASE_US * 1e-3
    if kind != 'controller':
        assert age > 100.0  # it was the lease that ended it, not something else
        assert scene.count('state HOLD') >= 1
