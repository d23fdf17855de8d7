"""Every frame that the sources name in a header is in the tree of the machine (docs/interfaces.md draws it)."""

from __future__ import annotations

import json
import re

import yaml
from code_names import ROOT, SRC

from waam_bridge.frame_tree import MACHINE, STANDOFF, TORCH, WORK

TREE = {MACHINE, WORK, TORCH, STANDOFF, 'scanner'}
NAMED = re.compile(r"\bframe(?:_id)?=['\"](\w+)['\"]")
IN_TYPES = re.compile(r"frame_id '(\w+)'")


def test_frames_that_sources_and_types_name_are_in_the_tree():
    python = [p for p in SRC.glob('waam_*/waam_*/**/*.py')]
    named = {(f, p.name) for p in python for f in NAMED.findall(p.read_text())}
    named |= {
        (f, p.name)
        for p in SRC.glob('waam_msgs/msg/*.msg')
        for f in IN_TYPES.findall(p.read_text())
    }
    assert {f for f, _ in named} == TREE, sorted(named)


def test_the_page_draws_the_tree():
    page = (ROOT / 'docs' / 'interfaces.md').read_text()
    drawn = page.split('## Frames')[1].split('## ')[0]
    assert not [f for f in TREE if not re.search(rf'─ {f}\b|^{f}\b', drawn, re.MULTILINE)]


def test_the_views_name_topics_and_frames_that_exist():
    """RViz configuration and Foxglove layout against the table of topics."""
    config = SRC / 'waam_bringup' / 'config'
    table = (ROOT / 'docs' / 'interfaces.md').read_text().split('## Topics')[1].split('\n## ')[0]
    topics = set(re.findall(r'`/?([\w/]+)`', table))
    rviz = yaml.safe_load((config / 'cell.rviz').read_text())['Visualization Manager']
    shown = [d.get('Topic', d.get('Description Topic')) for d in rviz['Displays']]
    used = {t['Value'] for t in shown if t}
    layout = (config / 'foxglove.json').read_text()
    assert json.loads(layout)['layout']
    used |= {t.split('.')[0] for t in re.findall(r'"/([\w/.]+)"', layout)}
    assert len(used) > 7 and used <= topics
    assert rviz['Global Options']['Fixed Frame'] in TREE
