"""The recorder's graph for the tests of this folder."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def graph():
    """graph(*parameters, **options) -> a recorder process and a node that calls it."""
    from recorder_graph import Graph

    from waam_node.testing import fresh_domain

    made = []

    def make(*parameters: str, **options: str) -> Graph:
        made.append(Graph(fresh_domain(), *parameters, **options))
        return made[-1]

    yield make
    for g in made:
        g.close()
