"""Bytes that no honest host would send: after every tick the harnesses of test/fuzz hold what the protocol promises."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest


@pytest.mark.parametrize(('harness', 'runs'), [('gcode', 20_000), ('link', 5_000), ('core', 1_500)])
def test_corpus_and_mutations_under_sanitizers(controller_path, harness, runs):
    """The harnesses of test/fuzz/ without libFuzzer: always the same mutations, any broken promise aborts."""
    program = controller_path.resolve().parent / f'fuzz_{harness}_replay'
    if not program.exists():
        pytest.skip('this compiler has no address and undefined-behaviour sanitizers')
    corpus = Path(__file__).parents[1] / 'test/fuzz/corpus' / harness
    done = subprocess.run(
        [str(program), str(corpus), str(runs)],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert f' {runs} mutations, no finding' in done.stdout
    assert int(done.stdout.split()[0]) == len(list(corpus.iterdir()))


def test_replay_finds_what_is_broken(controller_path, tmp_path):
    """The driver can fail: no input, no success."""
    program = controller_path.resolve().parent / 'fuzz_core_replay'
    if not program.exists():
        pytest.skip('this compiler has no address and undefined-behaviour sanitizers')
    assert subprocess.run([str(program), str(tmp_path)], capture_output=True).returncode == 2
    assert subprocess.run([str(program), str(tmp_path / 'no')], capture_output=True).returncode == 2
