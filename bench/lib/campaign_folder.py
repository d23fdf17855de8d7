"""A second start on a folder in which a graph runs, and a /dev/shm that fills up in the arc."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from .campaign_graph import Graph, Job, until
from .campaign_strangers import judged


def second_up(graph: Graph, rng: random.Random) -> dict:
    """`waam up` on the folder of a running graph while an arc burns: it is refused and changes nothing."""
    graph.live()
    job = Job(graph)
    until(lambda: graph.burns() or not job.runs(), 60.0)
    command = [sys.executable, '-m', 'waam_bringup.cli', 'up', '--run', str(graph.run)]
    second = subprocess.run(command, capture_output=True, text=True, timeout=90.0)
    facts = judged(graph, job)
    words = (second.stderr.strip() or second.stdout.strip()).splitlines()[-1:]
    refused = second.returncode != 0 and 'up already' in ' '.join(words)
    return facts | {
        'refused': words,
        'right': facts['right'] and refused and facts['ended'] == 'DONE',
    }


def full_shared_memory(graph: Graph, rng: random.Random) -> dict:
    """A graph in a name space of its own whose /dev/shm (a quarter of a gigabyte) is filled while an arc burns. Needs
    root; others of the machine keep their /dev/shm."""
    if not shutil.which('unshare') or os.geteuid() != 0:
        raise RuntimeError('needs unshare and root')
    here = Path(__file__).resolve().parent.parent
    code = f'import sys; sys.path.insert(0, {str(here)!r}); from lib.campaign_folder import fill; fill()'
    mount = 'mount -t tmpfs -o size=256m tmpfs /dev/shm'
    command = ['unshare', '-m', 'bash', '-c', f'{mount} && exec {sys.executable} -c "$0"', code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400.0)
    if done.returncode:
        raise RuntimeError(done.stderr[-300:])
    return json.loads(done.stdout.splitlines()[-1])


def fill() -> None:
    """In that name space: prints the facts of the trial."""
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        graph = Graph(Path(folder))
        try:
            graph.live()
            job = Job(graph)
            until(lambda: graph.burns() or not job.runs(), 60.0)
            free = shutil.disk_usage('/dev/shm').free
            with open('/dev/shm/full', 'wb') as f:
                os.posix_fallocate(f.fileno(), 0, max(1, free - 4096))
            print(json.dumps(judged(graph, job)))
        finally:
            graph.down()
