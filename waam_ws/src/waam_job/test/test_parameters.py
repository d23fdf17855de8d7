"""Dataclass, parameter file and README say the same."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import yaml

from waam_job.job_sequencer_node import JobParams
from waam_node.params import from_dict, markdown

PACKAGE = Path(__file__).parents[1]


def test_file_names_every_parameter_with_its_default():
    text = (PACKAGE / 'config' / 'job_sequencer.yaml').read_text()
    values = yaml.safe_load(text)['/**/job_sequencer']['ros__parameters']
    assert set(values) == {f.name for f in fields(JobParams)}
    loaded = from_dict(JobParams, {**values, 'lease_nodes': []})
    assert loaded == JobParams()


def test_readme_has_the_table():
    assert markdown(JobParams) in (PACKAGE / 'README.md').read_text()
