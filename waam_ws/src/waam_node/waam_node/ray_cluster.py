"""Pieces of work on an existing Ray cluster. Ray schedules, moves data and starts lost work again; it is not installed
with this software (requirements-cluster.txt)."""

from __future__ import annotations

import logging
import os
import re
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from typing import Any, TypeVar

Key = TypeVar('Key')
Piece = TypeVar('Piece')
Result = TypeVar('Result')
KNOCK_S = 5.0  # at most, until the address of a cluster answers
RETRIES = 3  # of a piece whose worker or machine was lost
_address: list[str] = []  # of the cluster that this process is connected to


class ClusterError(ValueError):
    """There is no Ray here, or no cluster at that address; the text says what to do."""


def results(
    pieces: Mapping[Key, Piece],
    work: Callable[[Piece], Result],
    lost: Callable[[Piece, Exception], Result],
    address: str,
    one_thread: tuple[str, ...],
) -> Iterator[tuple[Key, Result]]:
    """As of `spread`. Every machine needs this software and the files of the pieces under the same paths.

    one_thread: variables that give every worker one thread. ClusterError.
    """
    ray = connected(address, one_thread)
    remote = ray.remote(num_cpus=1, max_retries=RETRIES)(work)
    tasks = {remote.remote(piece): key for key, piece in pieces.items()}
    try:
        while tasks:
            (task,), _ = ray.wait(list(tasks), num_returns=1)
            key = tasks.pop(task)
            try:
                # a copy: large arrays lie in memory of Ray, read only, and go with the connection
                yield key, deepcopy(ray.get(task))
            except ray.exceptions.RayError as e:
                yield key, lost(pieces[key], e)
    finally:
        for task in tasks:  # the caller has stopped
            ray.cancel(task, force=True)


def connected(address: str, one_thread: tuple[str, ...]) -> Any:
    """The module ray, connected. It stays so until the process ends, because new workers have to load everything.
    ClusterError."""
    try:
        import ray
    except ImportError:
        raise ClusterError(
            '--cluster: Ray is not installed (pip install -r requirements-cluster.txt)'
        ) from None
    if ray.is_initialized() and _address == [address]:
        return ray
    _knock(address)
    ray.shutdown()
    variables = dict.fromkeys(one_thread, '1') | {
        'PYTHONPATH': os.pathsep.join(p for p in sys.path if p)
    }
    environment = {'env_vars': variables}
    try:
        ray.init(
            address=address,
            runtime_env=environment,
            log_to_driver=False,
            logging_level=logging.WARNING,
        )
    except (ConnectionError, ValueError, RuntimeError) as e:
        text = ' '.join(str(e).split())
        raise ClusterError(f'--cluster {address}: no Ray cluster answers there ({text})') from None
    _address[:] = [address]
    return ray


def _knock(address: str) -> None:
    """ClusterError when nothing listens at HOST:PORT: Ray itself asks for more than a minute before it says so."""
    named = re.fullmatch(r'(?:ray://)?([^:/]+|\[[^]]+\]):(\d{1,5})', address)
    if named is None:  # such as auto
        return
    try:
        socket.create_connection((named[1].strip('[]'), int(named[2])), KNOCK_S).close()
    except (OSError, OverflowError) as e:
        raise ClusterError(f'--cluster {address}: nothing answers there ({e})') from None
