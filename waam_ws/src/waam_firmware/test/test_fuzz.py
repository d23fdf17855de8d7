"""Bytes that no honest host would send never crash the controller and never move it, unless a line is valid."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SETTINGS = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
# the real-time bytes are meant to act
QUIET = st.integers(0, 255).filter(lambda b: b not in (0x80, 0x81, 0x82))
LETTERS = st.sampled_from('GMXYZFPWSNETQ')
WORD = st.builds(
    '{}{}'.format,
    LETTERS,
    st.one_of(
        st.integers(-(10**12), 10**12),
        st.floats(-500, 500).map(lambda x: f'{x:.4f}'),
        st.sampled_from(['', '.', '-', '1e9', '+']),
    ),
)


@pytest.fixture
def homed(client):
    client.home()
    return client


def settle(client) -> dict[str, int]:
    """The frame after everything sent so far was worked on."""
    client.text('\n$V 1000 1000')  # the line feed ends what was cut off
    client.raw(b'\n')
    client.ask('$V 1000 1000')
    return client.next_frame()


def position(frame: dict[str, int]) -> tuple[int, ...]:
    return (
        frame['x_um'],
        frame['y_um'],
        frame['z_um'],
        frame['line_accepted'],
        frame['wire_cmd_um_s'],
    )


def test_random_bytes_never_move_the_machine(homed):
    before = position(settle(homed))

    @SETTINGS
    @given(st.lists(QUIET, max_size=400).map(bytes))
    def bytes_in(data: bytes) -> None:
        homed.raw(data)

    bytes_in()
    frame = settle(homed)
    assert position(frame) == before and frame['state'] == 0


def test_mutated_lines_never_move_the_machine(homed):
    """One changed, lost or doubled byte in a sealed line: the check finds it."""
    before = position(settle(homed))

    @SETTINGS
    @given(st.data())
    def mutate(data) -> None:
        line = bytearray(
            homed.sealed(
                f'N2 G1 X{data.draw(st.integers(1, 300))} Y7 F{data.draw(st.integers(60, 6000))}'
            )
        )
        at = data.draw(st.integers(0, len(line) - 2))
        kind = data.draw(st.sampled_from(['change', 'lose', 'double']))
        if kind == 'lose':
            del line[at]
        elif kind == 'double':
            line.insert(at, line[at])
        else:
            line[at] ^= data.draw(st.integers(1, 127))
        homed.raw(bytes(line))

    mutate()
    assert position(settle(homed)) == before


def test_any_words_in_a_valid_line_are_accepted_or_refused(homed):
    """The number goes up only by what was accepted, and an error names a column inside the line."""

    @SETTINGS
    @given(st.lists(WORD, max_size=8).map(' '.join))
    def words(text: str) -> None:
        line = f'N{homed.next} {text}'[:140]
        start = len(homed.lines)
        homed.text(line)
        answer = homed.wait_line('^(ok|er)', start)
        if answer.startswith('er'):
            column = int(answer.split()[3][1:])
            assert 1 <= column <= len(line) and 102 <= int(answer.split()[2][1:]) <= 305
            homed.ask('$S')
            homed.ask(f'$L {homed.next}')
        else:
            assert answer.startswith(f'ok N{homed.next} ')
            homed.next += 1
            homed.ask('$S')
            homed.ask(f'$L {homed.next}')
        homed.wait(lambda: homed.frame['state'] == 0)

    homed.next = 2
    words()


@pytest.mark.parametrize(('harness', 'runs'), [('gcode', 20_000), ('link', 5_000), ('core', 1_500)])
def test_corpus_and_mutations_under_sanitizers(controller_path, harness, runs):
    """The harnesses of fuzz/ without libFuzzer: always the same mutations, any broken promise aborts."""
    program = controller_path.resolve().parent / f'fuzz_{harness}_replay'
    if not program.exists():
        pytest.skip('this compiler has no address and undefined-behaviour sanitizers')
    corpus = Path(__file__).parents[1] / 'fuzz/corpus' / harness
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
