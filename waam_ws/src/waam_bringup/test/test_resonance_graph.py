"""`waam calibrate resonance` on a real graph: virtual controller on its pty, swinging gantry, accelerometer, DDS."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from waam_bringup import cli
from waam_bringup.client import GraphClient
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_bringup.shaking import Shaking
from waam_node.testing import fresh_domain
from waam_sim import part
from waam_sim.compiled import random_state
from waam_sim.config import CellParams
from waam_sim.gantry import Gantry, GantryParams
from waam_sim.metal_params import MetalParams

HZ, DAMPING = 35.0, 0.05
NOT_NEEDED = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder',
    'dashboard', 'panel',
)  # fmt: skip
SWINGING = {
    'gantry_on': True, 'gantry_x_hz': HZ, 'gantry_x_damping': DAMPING, 'gantry_hz_per_m': 0.0,
    'gantry_x_second_hz': 90.0,
}  # fmt: skip
SWEEP = ('--from-hz', '15', '--to-hz', '60', '--rate', '6')


def calibrate(run: Path, domain: int, *more: str) -> int:
    where = ('--run', str(run), '--domain', str(domain))
    return cli.main(['calibrate', 'resonance', '--axis', 'x', *SWEEP, *where, *more])


def true_hz() -> float:
    """Of the first mode of X, with the plate of the cell on the table."""
    metal = MetalParams()
    plate = part.plate(*CellParams().plate, metal.cell, metal.margin)
    params = GantryParams(on=True, x_hz=HZ, x_damping=DAMPING, hz_per_m=0.0)
    return Gantry(params, random_state(1, 6), part.volume(plate)).hz(0, 0.0)


def publishers(domain: int, topic: str) -> list[str]:
    """Nodes that publish it."""
    with GraphClient(domain) as client:
        node = client.node

        def named() -> bool:
            """Discovery may tell of a publisher before it knows whose it is."""
            found = node.get_publishers_info_by_topic(topic)
            return bool(found) and '_NODE_NAME_UNKNOWN_' not in [p.node_name for p in found]

        client.until(named, 20.0)
        return [p.node_name for p in node.get_publishers_info_by_topic(topic)]


def test_the_mode_of_the_gantry_is_found_and_its_shaper_told(tmp_path, monkeypatch, capfd):
    """Found within 1 %; kept with its report and samples; its shaper in force in the controller."""
    monkeypatch.setenv('WAAM_CALIBRATIONS', str(tmp_path / 'kept'))
    params = tmp_path / 'swing.yaml'
    params.write_text(yaml.safe_dump({'cell': {'ros__parameters': SWINGING}}))
    run, domain = tmp_path / 'run', fresh_domain()
    settings = Settings(run=run, seed=5, params_files=(params,), without=NOT_NEEDED)
    with graph(settings, domain, timeout=60.0):
        point = ('--point', '150', '120', '60')
        assert calibrate(run, domain, *point) == 0
        assert publishers(domain, 'acceleration') == ['bridge'], 'as on the board'
        assert calibrate(run, domain, '--point', '5000', '120', '60') != 0, 'off the machine'
        with Shaking(domain) as client:
            in_force = client.told()
    said = capfd.readouterr().out
    (file,) = (tmp_path / 'kept').glob('*.yaml')
    found = yaml.safe_load(file.read_text())
    assert file.with_suffix('.html').is_file() and file.with_suffix('.npz').is_file()
    told = next(x for x in said.splitlines() if x.startswith('controller: '))
    assert 'delay_ms=' in told and 'corner_mm_s=' in told
    assert found['values']['mode_hz'] == pytest.approx(true_hz(), rel=0.01)
    shaper = dict(found['settings'])
    assert in_force['shape_x'] == shaper['shape_x'], 'after a sweep that was refused'
    proposed = found['values']['acceleration_mm_s2']
    accel = min(proposed, in_force['accel_limit_x'])
    assert in_force['max_accel_x'] == shaper['max_accel_x'] == accel
    assert f'acceleration {shaper["max_accel_x"]:g} mm/s^2 ({proposed:g} proposed' in said
    assert shaper['shape_x_hz'] == pytest.approx(true_hz(), rel=0.08) and shaper['shape_x'] > 0
