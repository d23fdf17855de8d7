"""`waam replay play`: the player as a process of its own; in lock-step also the nodes that are asked, with the
parameters that they were recorded with, in a ROS domain where nothing else runs."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml

from waam_record.bag_reader import info

from .record import record_folder

ASKED = {
    'scan_fusion': 'waam_scan.scan_fusion_node',
    'correction_server': 'waam_adapt.correction_server_node',
    'feed_forward': 'waam_adapt.feed_forward_node',
}
DOMAINS = 99  # 1 .. 99: their ports lie below those that the system hands out
END_S = 10.0


def start(module: str, domain: int | None, arguments: list[str], quiet: bool) -> subprocess.Popen:
    """The `main` of a node module as a process."""
    command = [sys.executable, '-c', f'from {module} import main; main()', '--ros-args', *arguments]
    env = dict(os.environ) if domain is None else {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    env.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    output = subprocess.DEVNULL if quiet else None
    return subprocess.Popen(command, env=env, stdout=output, stderr=output)


def end(processes: list[subprocess.Popen]) -> None:
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def nodes(folder: Path, domain: int) -> Iterator[None]:
    """The nodes that a job asks, with the parameters in the record."""
    custom = info(folder).custom_data
    with tempfile.TemporaryDirectory(prefix='waam_replay_') as scratch:
        running = []
        try:
            for name, module in ASKED.items():
                values = json.loads(custom.get(f'parameters.{name}', '{}'))
                values['use_sim_time'] = True
                file = Path(scratch) / f'{name}.yaml'
                file.write_text(yaml.safe_dump({name: {'ros__parameters': values}}))
                running.append(start(module, domain, ['--params-file', str(file)], quiet=True))
            yield
        finally:
            end(running)


def parameters(values: dict[str, object]) -> list[str]:
    """`-p name:=value` for everything that is set."""
    made: list[str] = []
    for name, value in values.items():
        if value in ('', None):
            continue
        text = json.dumps(value) if isinstance(value, bool | float | int) else f"'{value}'"
        made += ['-p', f'{name}:={text}']
    return made


def play(args: argparse.Namespace) -> int:
    """Runs until the record is over or Ctrl-C. Exit status 1 when lock-step found a difference."""
    folder = record_folder(args.job)
    values: dict[str, object] = {'record': str(folder.resolve()), 'lockstep': args.lockstep}
    if not args.lockstep:
        values |= {
            'rate': float(args.rate), 'topics': ' '.join(args.topics), 'exclude': args.exclude,
            'remap': ' '.join(args.remap), 'start': float(args.start), 'until': float(args.until),
            'paused': args.paused, 'force': args.force,
        }  # fmt: skip
        return _wait(start('waam_replay.player_node', None, parameters(values), quiet=False))
    with tempfile.TemporaryDirectory(prefix='waam_replay_') as scratch:
        report = Path(scratch) / 'report.json'
        values['report'] = str(report)
        if args.attach:
            _wait(start('waam_replay.player_node', args.domain, parameters(values), quiet=False))
        else:
            domain = args.domain if args.domain is not None else 1 + os.getpid() % DOMAINS
            with nodes(folder, domain):
                _wait(start('waam_replay.player_node', domain, parameters(values), quiet=False))
        return _judge(report)


def _wait(process: subprocess.Popen) -> int:
    try:
        return process.wait()
    except KeyboardInterrupt:
        end([process])
        return 130


def _judge(report: Path) -> int:
    if not report.exists():
        print('error: the player ended before its work was done', file=sys.stderr)
        return 1
    found = json.loads(report.read_text())
    for kind, total in found['total'].items():
        print(f'{kind}: {found["identical"][kind]} of {total} identical')
    for text in found['differences']:
        print(f'different: {text}')
    if found['error']:
        print(f'error: {found["error"]}', file=sys.stderr)
    print(f'{found["seconds"]:.1f} s')
    return 0 if found['same'] else 1
