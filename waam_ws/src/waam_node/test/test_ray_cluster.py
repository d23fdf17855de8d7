"""Work on a Ray cluster of this machine: results, workers that die, work that cannot be done. Skipped without Ray."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import numpy as np
import pytest

from waam_node.ray_cluster import ClusterError
from waam_node.spread import Workers, spread

pytest.importorskip('ray', reason='Ray is not installed (requirements-cluster.txt)')


@pytest.fixture(scope='module')
def address():
    """Of a node with two cores."""
    import ray
    from ray.cluster_utils import Cluster

    head = {'num_cpus': 2, 'object_store_memory': 100 << 20, 'include_dashboard': False}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    yield cluster.address
    ray.shutdown()
    cluster.shutdown()


def squared(piece: tuple[int, str, Path]) -> int:
    """Whose worker dies: 'once' or 'always'. 'wrong': an error of the work itself."""
    number, how, folder = piece
    died = folder / f'{number}.died'
    if how == 'always' or (how == 'once' and not died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == 'wrong':
        raise ValueError('no such number')
    return number**2


def large(number: int) -> np.ndarray:
    """More than Ray sends with its answer: it lies in shared memory."""
    return np.full(200_000, float(number))


def lost(piece: tuple[int, str, Path], error: Exception) -> int:
    return -piece[0]


def test_a_lost_worker_costs_its_piece_and_what_is_always_lost_is_told(address, tmp_path):
    how = {1: '', 2: 'once', 3: 'wrong', 4: '', 5: 'always'}
    pieces = {n: (n, h, tmp_path) for n, h in how.items()}
    found = dict(spread(pieces, squared, lost, Workers(cluster=address)))
    assert found == {1: 1, 2: 4, 3: -3, 4: 16, 5: -5}


def test_large_results_outlive_the_connection_and_can_be_written(address):
    import ray

    found = dict(spread({n: n for n in range(3)}, large, lost, Workers(cluster=address)))
    ray.shutdown()
    for number, array in found.items():
        assert (array == number).all()
        array += 1


def test_a_caller_that_stops_leaves_the_cluster_to_others(address, tmp_path):
    pieces = {n: (n, '', tmp_path) for n in range(6)}
    begun = spread(pieces, squared, lost, Workers(cluster=address))
    next(begun)
    begun.close()
    assert dict(spread(pieces, squared, lost, Workers(cluster=address))) == {
        n: n**2 for n in range(6)
    }


def test_an_address_where_nothing_listens_is_named_at_once():
    with socket.socket() as bound:
        bound.bind(('127.0.0.1', 0))  # and nobody listens
        port = bound.getsockname()[1]
        for address in (f'127.0.0.1:{port}', f'ray://127.0.0.1:{port}', '127.0.0.1:99999'):
            with pytest.raises(ClusterError, match='nothing answers there'):
                next(spread({1: 1}, large, lost, Workers(cluster=address)))
