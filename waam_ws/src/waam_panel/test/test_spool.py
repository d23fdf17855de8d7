"""Wire on the spool against the need of the job: by its own files, and not known where nobody told."""

import json

import numpy as np
import pytest
import yaml

from waam_panel.queued import fields_of
from waam_panel.setup_form import FormError, parse
from waam_panel.spool import CLOSE, FITS, SHORT, spool_of

SECTION = np.pi / 4 * 1.2e-3**2 * 0.92


@pytest.fixture
def job(tmp_path):
    """Three layers; each takes 2 m of wire by the plan. An idle move between costs nothing."""
    length = 2.0 * SECTION / (0.73 * 6e-3 * 2e-3)
    way = np.array([[0, 0, 0.0], [length, 0, 0]])
    about = {'settings': {'wire_diameter': 1.2e-3, 'efficiency': 0.92}}
    np.savez(
        tmp_path / 'plan.npz', about=json.dumps(about), start=way[[0, 1] * 3], end=way[[1, 0] * 3],
        arc=[True, False] * 3,
        layer=np.repeat([1, 2, 3], 2), width=np.full(6, 6e-3), height=np.full(6, 2e-3),
    )  # fmt: skip
    (tmp_path / 'job.yaml').write_text(yaml.safe_dump({'goal': {'wire_left': 10.0}}))
    return tmp_path


def records(folder, spool, used):
    layers = [{'layer': n, 'final': False, 'wire_used': u} for n, u in enumerate(used, 1)]
    (folder / 'records.json').write_text(json.dumps({'spool': spool, 'layers': layers}))


def test_before_the_first_layer_it_is_what_was_told_and_the_whole_plan(job):
    assert spool_of(job) == {'layer': 0, 'left_m': 10.0, 'need_m': 6.0, 'words': FITS}


@pytest.mark.parametrize(
    'spool, used, need, words',
    [
        (8.0, [2.0], 4.0, FITS),
        (4.5, [2.0], 4.0, CLOSE),
        (3.9, [2.0], 4.0, SHORT),
        (5.9, [3.0], 6.0, SHORT),  # took half as much again as planned
        (4.9, [1.0], 4.0, FITS),  # took less: not counted on
        (-0.1, [2.0, 2.0], 2.0, SHORT),
        (1.0, [2.0, 2.0, 2.0], 0.0, FITS),
    ],
)
def test_after_a_layer_it_is_what_the_job_has_written(job, spool, used, need, words):
    records(job, spool, used)
    assert spool_of(job) == {'layer': len(used), 'left_m': spool, 'need_m': need, 'words': words}


def test_in_a_later_pass_the_plan_counts_its_layers_anew(job):
    (job / 'plan.npz').rename(job / 'plan_2.npz')
    layers = [
        {'layer': n, 'pass_number': 1 + (n > 2), 'final': False, 'wire_used': 2.0}
        for n in (1, 2, 3)
    ]
    (job / 'records.json').write_text(json.dumps({'spool': 3.9, 'layers': layers}))
    assert spool_of(job, 2) == {'layer': 3, 'left_m': 3.9, 'need_m': 4.0, 'words': SHORT}


def test_what_nobody_told_is_not_known(job):
    (job / 'job.yaml').write_text(yaml.safe_dump({'goal': {'wire_left': 0.0}}))
    assert spool_of(job) is None
    records(job, None, [2.0])
    assert spool_of(job) is None
    (job / 'job.yaml').unlink()
    assert spool_of(job) is None


def test_without_a_plan_the_need_is_not_known(job):
    (job / 'plan.npz').write_bytes(b'torn')
    assert spool_of(job) == {'layer': 0, 'left_m': 10.0, 'need_m': None, 'words': ''}


def test_the_form_takes_it_and_the_queue_does_not():
    form = {'part': 'a.stl', 'wire_left_m': '12,5'}
    setup = parse(form, ('er70s-6',))
    assert setup.wire_left_m == 12.5 and '12.5 m of wire on the spool' in setup.words
    with pytest.raises(FormError, match='wire_left_m: .*queue'):
        fields_of(form, ('er70s-6',))
    with pytest.raises(FormError, match='wire_left_m'):
        parse(form | {'wire_left_m': -1}, ('er70s-6',))
    assert fields_of({'part': 'a.stl', 'wire_left_m': None}, ('er70s-6',))['wire_left_m'] == 0.0
