"""The host shell: command line, what it leaves behind, pacing."""

from __future__ import annotations

import os
import socket
import subprocess
import time

import pytest


@pytest.fixture
def program(controller_path) -> str:
    return str(controller_path)


@pytest.mark.parametrize(
    'arguments',
    [
        ['--rate', '-1'],
        ['--rate', 'fast'],
        ['--rate', 'nan'],
        ['--epoch-us', '-5'],
        ['--epoch-us', '1.5'],
        ['--start', '1,2'],
        ['--start', '1,2,900'],
        ['--plant', '/tmp/x', '--null-plant'],
        ['something'],
        ['--unknown'],
        ['--rate'],
        ['--plant', '/nonexistent/x.sock'],
        ['--pty-link', '/nonexistent/tty'],
        ['--events', '/nonexistent/log'],
        ['--plant', 'x' * 200],
    ],
)
def test_wrong_arguments_are_refused_with_one_message(program, arguments):
    result = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=5)
    assert result.returncode in (1, 2) and result.stdout == ''
    assert len(result.stderr.splitlines()) == 1 and 'virtual_controller: ' in result.stderr


def test_help_teaches(program):
    text = subprocess.run(
        [program, '--help'], capture_output=True, text=True, timeout=5, check=True
    ).stdout
    for word in (
        '--pty-link',
        '--plant',
        '--null-plant',
        '--rate',
        '--epoch-us',
        '--events',
        'M3 is refused',
        'examples',
    ):
        assert word in text


def test_leaves_nothing_behind(start, tmp_path):
    path = tmp_path / 'cell.sock'
    controller = start('--plant', str(path))
    assert controller.link.is_symlink() and path.is_socket()
    controller.close()
    assert not controller.link.is_symlink() and not path.exists()


def test_stale_link_and_socket_are_replaced(start, program, tmp_path):
    path = tmp_path / 'cell.sock'
    stale = socket.socket(socket.AF_UNIX)
    stale.bind(str(path))
    stale.close()
    os.mkdir(tmp_path / 'run')
    (tmp_path / 'run/tty').symlink_to('/nonexistent')
    process = subprocess.Popen(
        [program, '--plant', str(path), '--pty-link', str(tmp_path / 'run/tty')],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline().startswith('ready /dev/pts/')
        assert (tmp_path / 'run/tty').exists()
        second = subprocess.run(
            [program, '--plant', str(path)], capture_output=True, text=True, timeout=5
        )
        assert second.returncode == 1 and 'another controller listens there' in second.stderr
    finally:
        process.terminate()
        assert process.wait(5) == 0
        process.stdout.close()


def test_a_file_in_the_way_is_not_touched(program, tmp_path):
    path = tmp_path / 'file'
    path.write_text('precious')
    for option in ('--pty-link', '--plant'):
        result = subprocess.run(
            [program, option, str(path)], capture_output=True, text=True, timeout=5
        )
        assert result.returncode == 1 and 'exists and is not' in result.stderr
    assert path.read_text() == 'precious'


def simulated_seconds(client, seconds: float) -> float:
    first = client.next_frame()['t_us']
    begin = time.monotonic()
    client.wait(lambda: time.monotonic() > begin + seconds)
    return (client.frame['t_us'] - first) * 1e-6 / (time.monotonic() - begin)


@pytest.mark.parametrize(
    ('rate', 'low', 'high'), [('1', 0.2, 1.3), ('5', 1.2, 6.0), ('0', 1.5, 1e9)]
)
def test_rate_limits_simulated_time(start, rate, low, high):
    """Never faster than the rate. How much slower is up to the machine: one half second of 40 has to come near it."""
    client = start('--null-plant', '--rate', rate).connect()
    for _ in range(40):
        reached = simulated_seconds(client, 0.5)
        assert reached < high
        if reached > low:
            return
    raise AssertionError(f'never faster than {low} times real time at rate {rate}')


def test_without_heartbeat_time_is_real(start):
    client = start('--null-plant', '--rate', '0').connect(heartbeat=False)
    client.identify()
    assert simulated_seconds(client, 0.5) < 1.5


def test_host_that_does_not_read_slows_time_and_loses_no_answer(start):
    """For a second the host sends lines and heartbeats but reads nothing: telemetry may be dropped, answers may not."""
    controller = start('--null-plant', '--rate', '0', '--start', '8,6,195')
    client = controller.connect()
    client.home()
    client.paused = True
    begin, last = time.monotonic(), client.frame['t_us']
    while time.monotonic() < begin + 1.0:
        client.text('$H x 0')
        client.sequence += 1
        client.numbered(client.sequence, 'G4 P0')
        time.sleep(0.01)
    advanced = controller.events()[-1][0] - last  # every G4 is an event
    client.paused = False
    client.wait(lambda: client.accepted == client.sequence)
    assert [x.split()[1] for x in client.lines if x.startswith('ok')] == [
        f'N{i + 1}' for i in range(client.sequence)
    ]
    assert client.bad_checks == 0
    assert advanced < 30e6  # what the terminal's buffers take, then real time
