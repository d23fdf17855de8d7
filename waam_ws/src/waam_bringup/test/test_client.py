"""The command line's end of the graph, without a graph."""

import os

import pytest

from waam_bringup.client import ClientError, GraphClient
from waam_msgs.action import RunJob
from waam_node.testing import fresh_domain


def test_a_client_that_asked_for_a_job_leaves_the_domain_when_it_is_closed():
    """Participants are numbered; in a process that runs many jobs they would soon pass what discovery looks for."""
    domain, name = fresh_domain(), f'waam_cli_{os.getpid()}'
    with GraphClient(domain) as watcher:

        def here() -> int:
            return watcher.node.get_node_names().count(name)

        with GraphClient(domain) as client:
            assert watcher.until(lambda: here() == 2, 10.0)
            with pytest.raises(ClientError, match='job_sequencer is not there'):
                client.run_job(RunJob.Goal(), lambda status: None)
        assert watcher.until(lambda: here() == 1, 10.0)
