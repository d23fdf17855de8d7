import ast
import math
import re
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from waam_plan.robot.cell import AbbSettings, FanucSettings, KukaSettings, RobotCell
from waam_plan.settings import PlanSettings, SettingsError, assigned


def test_defaults_describe_the_regime_of_eq_2_17():
    s = PlanSettings()
    assert 0.55 <= s.pitch_ratio <= 0.70  # where beads of source 003 join without valleys
    feed = 0.73 * s.bead_width * s.layer_height * s.speed / (s.wire_area * s.efficiency)
    assert 60 * feed == pytest.approx(5.05, abs=0.05)  # m/min


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('layer_height', 0.0),
        ('layer_height', math.nan),
        ('bead_width', 0.5),
        ('pitch_ratio', 1.2),
        ('speed', -0.01),
        ('segment_length', 0.0),
        ('min_layer', 1.5),
        ('clearance', 0.0),
        ('direction', 'z'),
        ('alternation', 'sometimes'),
        ('strategy', 'foam'),
        ('scanner_offset', (0.0, 1.0)),
        ('scanner_offset', (0.0, 1.0, math.inf)),
        ('scanner_range', (-0.1, -0.2)),
        ('speed', '10'),
        ('speed_max', 0.005),
    ],
)
def test_a_bad_setting_is_refused_by_name(field, value):
    with pytest.raises(SettingsError, match=field):
        PlanSettings(**{field: value})


@pytest.mark.parametrize(
    'kind, title',
    [
        (PlanSettings, '## Parameters'),
        (RobotCell, '### Robot programs'),
        (FanucSettings, '### Fanuc programs'),
        (KukaSettings, '### KUKA programs'),
        (AbbSettings, '### ABB programs'),
    ],
)
def test_the_readme_lists_every_setting_with_its_default(kind, title):
    text = (Path(__file__).parents[1] / 'README.md').read_text()
    section = text.split(f'\n{title}\n')[1].split('\n##')[0]
    rows = dict(re.findall(r'^\| `(\w+)` \| (.+?) \|', section, re.M))
    for f in fields(kind):
        if f.default is MISSING:
            continue  # settings of a language, in a table of their own
        assert ast.literal_eval(rows[f.name]) == f.default


def test_texts_become_values_of_their_kind():
    given = assigned(['levels=adaptive', 'stagger=true', 'contours=3', 'scanner_offset=0.1,0,0.2'])
    assert given == {
        'levels': 'adaptive', 'stagger': True, 'contours': 3, 'scanner_offset': (0.1, 0.0, 0.2)
    }  # fmt: skip
    assert assigned([]) == {}


def test_all_that_is_wrong_with_texts_is_said_at_once():
    texts = [
        'speed=fast',
        'stagger=perhaps',
        'edge_metal=9',
        'nonsense=1',
        'clearance',
        'grid=0.001',
    ]
    with pytest.raises(SettingsError) as caught:
        assigned(texts, {'grid'})
    said = str(caught.value)
    for words in (
        "speed=fast: 'fast' is not a float", "'perhaps' is not a bool", 'between 0.5 and 1.5',
        'no setting nonsense', 'clearance: not of the form', 'grid is given by', 'known: layer_height, ',
    ):  # fmt: skip
        assert words in said, words
    assert 'grid, ' not in said.split('known: ')[1]


def test_all_fields_that_are_wrong_are_said_at_once():
    with pytest.raises(SettingsError, match='speed is 9.*; strategy is .foam.'):
        PlanSettings(speed=9.0, strategy='foam')
