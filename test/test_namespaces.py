"""Two cells in two namespaces of one ROS domain: each has its parameters, its job and its record; nothing crosses."""

from __future__ import annotations

from pathlib import Path

from rcl_interfaces.srv import GetParameters
from two_cells import lay_both, two_cells

from waam_bringup.client import GraphClient
from waam_node.testing import fresh_domain

VALUES = {
    'cell1': {'bridge': {'speed_max': 0.4}, 'correction_server': {'k_gain': 0.25}},
    'cell2': {'bridge': {'speed_max': 0.3}},
}
ONE_OF = ('telemetry', 'clock', 'tf', 'job_status', 'robot_description')  # one publisher in a cell
OF_ALL = {'/rosout', '/parameter_events'}


def value(client: GraphClient, node: str, name: str) -> float:
    asked = client.node.create_client(GetParameters, f'{node}/get_parameters')
    assert client.until(asked.service_is_ready, 20.0)
    future = asked.call_async(GetParameters.Request(names=[name]))
    assert client.until(future.done, 20.0)
    return future.result().values[0].double_value


def test_two_cells_in_one_domain_do_not_meet(tmp_path, part):
    domain = fresh_domain()
    with two_cells(tmp_path, domain, VALUES) as cells:
        lay_both(cells, part, 500.0)
        for cell in cells:
            (result,) = cell.results
            assert result.error_code == 0, result.message
            assert Path(result.job_dir).parent == cell.jobs
        with GraphClient(domain, cells[0].namespace) as client:
            ours = [f'/{c.namespace}/{t}' for c in cells for t in ONE_OF]
            count = client.node.count_publishers
            assert client.until(lambda: all(map(count, ours)), 60.0)
            assert [count(name) for name in ours] == [1] * len(ours)
            topics = dict(client.node.get_topic_names_and_types())
            assert {t for t in topics if not t.startswith(('/cell1/', '/cell2/'))} <= OF_ALL
            speeds = [value(client, f'/{c.namespace}/bridge', 'speed_max') for c in cells]
            assert speeds == [0.4, 0.3]
    for cell in cells:
        assert cell.strangers() == []
