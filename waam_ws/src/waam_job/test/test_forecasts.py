"""What was foretold of a job stands in its report, and a forecast of another wear does not."""

from __future__ import annotations

import json

import pytest

from waam_job.model.records import State
from waam_job.store import forecasts


@pytest.mark.parametrize('factor', [1.0, 1.5])
def test_the_report_has_the_forecast_of_this_wear(factor, make_cell, make_runner):
    runner, _, folder = make_runner(make_cell())
    place = forecasts.folder_of(runner.context.checked)
    place.mkdir(parents=True)
    inner = runner.passes.add

    def add(plan, keep=True):  # a forecast made of the same surface, or of another one
        volume = factor * plan.volume * 1e6
        forecasts.write(place, json.dumps({'volume_cm3': volume, 'fails': False}))
        inner(plan, keep)

    runner.passes.add = add
    assert runner.run().state == State.DONE
    run = json.loads((folder.path / 'report.json').read_text())['closed_loop']
    told = [a['text'] for a in run['anomalies'] if 'another wear' in a['text']]
    if factor == 1.0:
        assert run['forecast']['fails'] is False and not told
    else:
        assert run['forecast'] is None and told
