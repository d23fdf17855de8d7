"""The walks of docs/adding.md work: their code is taken from the page and put where the walk says."""

from __future__ import annotations

import argparse
import re
import sys
import types

import numpy as np
import pytest
import trimesh
from code_names import ROOT

import waam_adapt
from waam_adapt.laws import registry
from waam_plan import cli, cli_robot
from waam_plan.gcode.store import load_plan
from waam_process import materials
from waam_process.segment import Kind

PAGE = (ROOT / 'docs' / 'adding.md').read_text()


def code(heading: str) -> str:
    """The first block of code below a heading."""
    part = PAGE.split(f'\n## {heading}\n')[1].split('\n## ')[0]
    return re.search(r'```(?:python|yaml)\n(.*?)```', part, re.DOTALL)[1]


def module(name: str, text: str, monkeypatch) -> types.ModuleType:
    """The code as a module of that name."""
    made = types.ModuleType(name)
    made.__package__ = name.rpartition('.')[0]
    monkeypatch.setitem(sys.modules, name, made)
    exec(compile(text, name, 'exec'), made.__dict__)
    return made


def test_a_law_is_a_class_and_one_line(monkeypatch):
    half = module('waam_adapt.laws.half', code('A law'), monkeypatch).Half
    monkeypatch.setitem(registry.LAWS, 'half', lambda s: half())
    error = np.zeros((40, 60))
    error[10:30, 10:25], error[10:30, 35:50] = -0.4, 0.4
    path = np.array([[17.0, 20.0], [42.0, 20.0], [30.0, 20.0]])
    hollow, hump, level = waam_adapt.correct(error, 1.0, [path], 2.0, law='half')[0]
    assert hollow == pytest.approx(1 / 1.1, abs=1e-3) and hump == pytest.approx(1 / 0.9, abs=1e-3)
    assert level == pytest.approx(1.0)
    with pytest.raises(ValueError, match='known are .*half'):
        waam_adapt.correct(error, 1.0, [path], 2.0, law='hlaf')


def test_a_material_is_an_entry_of_the_table(tmp_path):
    table = tmp_path / 'materials.yaml'
    table.write_text(materials.TABLE.read_text() + '\n' + code('A material'))
    steel = materials.get('my-steel', table)
    assert steel.wire_diameter == pytest.approx(1e-3) and steel.interpass_limit == 165
    assert steel.feed_min < steel.wire_feed < steel.feed_max  # its regime can be laid
    with pytest.raises(materials.MaterialError, match='my-steel.*wire_diameter'):
        table.write_text(code('A material').replace('1.0 mm', '1.0'))
        materials.get('my-steel', table)


def test_a_post_processor_is_a_writer_and_a_name(monkeypatch, tmp_path):
    acme = module('waam_plan.robot.acme', code('A post-processor'), monkeypatch)
    monkeypatch.setattr(cli_robot, 'POSTS', (*cli_robot.POSTS, 'acme'))
    monkeypatch.setattr(cli_robot, 'writer', lambda post: acme.write_acme)
    trimesh.creation.box((40, 30, 6)).export(tmp_path / 'block.stl')
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(required=True))
    words = ['plan', tmp_path / 'block.stl', '--mode', 'build', '--post', 'acme', '--out', tmp_path]
    args = parser.parse_args([str(w) for w in words])
    assert args.run_command(args) == 0
    calls = re.findall(r'CALL (\w+) LIFT', (tmp_path / 'WAAM.acm').read_text())
    plan = load_plan(tmp_path / 'plan.npz')
    assert len(calls) >= len(plan.layers) - plan.settings.base_layers > 0
    laid = 0.0  # mm with the arc on
    for name in calls:
        at = None
        for line in (tmp_path / f'{name}.acm').read_text().splitlines()[1:]:
            here = np.array(line.split()[1:4], float)
            laid += np.linalg.norm(here - at) if 'WIRE' in line and 'VIA' not in line else 0.0
            at = here
    segments = [s for layer in plan.layers for s in layer.segments if s.kind == Kind.DEPOSIT]
    wanted = sum(np.linalg.norm(np.subtract(s.end, s.start)) for s in segments) * 1e3
    assert laid == pytest.approx(wanted, rel=0.1)
