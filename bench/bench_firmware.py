"""The controller core on the STM32F407: share of the processor's instructions, flash and RAM.

The firmware runs under QEMU with instruction counting (8 ns of virtual time for each) at its worst: X, Y, Z and wire
at their greatest speeds (200, 200, 100 and 300 mm/s: 64, 64, 32 and 15 thousand pulses per second), arc on, segments
of 1 mm streaming in, telemetry going out, the torch held at its distance by the arc, overrides of a held process value
coming in 25 times a second, and the samples of the accelerometer, which a job does without; the worse of two runs,
without an input shaper and with the one that has the most to do (its delay shortens what the wire looks ahead, so a
slow one costs less than none). Counted are instructions, not cycles: a Cortex-M4 needs some 1.3 for each.

firmware.isr_budget_pct: interrupts (pulses at 80 kHz, fast tick at 10 kHz, link) and the main loop, of 168 MHz;
firmware.cpu_budget_pct: the same with the 1 kHz tick of the core (planner, motion, link, arc sequence);
firmware.tick_longest_pct: longest single tick, of the instructions in 1 ms;
firmware.flash_bytes, firmware.ram_bytes: image with the link on USART2, RAM with its stack of 16 KiB.

Without gcc-arm-none-eabi or qemu-system-arm it says so on stderr and prints nothing.
"""

from __future__ import annotations

import importlib.util
import os
import re
import select
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from _pytest.outcomes import Failed
from lib.emit import emit
from lib.paths import SOURCES

PACKAGE = SOURCES / 'waam_firmware'
NS_PER_INSTRUCTION = 8.0
CLOCK_HZ = 168e6
ACCELEROMETER = 1
NO_SHAPER = ('shape_x 0', 'shape_y 0')
SHAPER = ('shape_x_hz 200', 'shape_y_hz 180', 'shape_x 6', 'shape_y 6')  # 3HUMP_EI: ten taps each
STANDOFF = ('set_mm 15', 'window_mm 50', 'kp 2', 'ki 0.5', 'source 3')
OVERRIDE_US = 40_000  # controller time between two overrides of a held value
CHIP_FLASH, CHIP_RAM = 1 << 20, 192 << 10


def load(name: str):
    """A module of the package's tests, by path; those that it imports lie beside it."""
    if str(PACKAGE / 'test') not in sys.path:
        sys.path.append(str(PACKAGE / 'test'))
    spec = importlib.util.spec_from_file_location(name, PACKAGE / f'test/{name}.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def stretch(report: str) -> dict[str, float]:
    """Of a report of the firmware: virtual seconds, instructions but idling, of the tick, of the longest tick."""
    elapsed, idle = map(int, report.split()[:2])
    parts = {k: [int(v) for v in vs.split()] for k, vs in re.findall(r'([a-z]+) ([0-9 ]+)', report)}
    return {
        'seconds': elapsed * 1e-9,
        'busy': (elapsed - idle) / NS_PER_INSTRUCTION,
        'tick': parts['tick'][1] / NS_PER_INSTRUCTION,
        'longest': parts['tick'][2] / NS_PER_INSTRUCTION,
    }


def burn(board, lines: list[str], shaper: tuple[str, ...]) -> None:
    """Streams until everything runs at top speed; again when a busy computer made the host lose its lease."""
    client = board.client
    client.wait(lambda: client.frame)
    for _ in range(5):
        client.lease = True
        client.ask('$S')
        client.wait(lambda: client.frame['state'] in (0, 3))
        client.ask('$X')
        client.identify()
        client.sequence = client.accepted = 0
        for setting in ('source 0', *shaper, *STANDOFF):
            answer = client.ask(f'$C {setting}')
            assert answer.startswith('$C ok'), answer
        client.run('G28', 'G0 X0 Y0 Z190')
        client.ask('$A bench')
        client.ask(f'$M {ACCELEROMETER}')
        with suppress(Failed):  # a host that was late waits in vain for room
            client.send('M3 W18000 S25', 'G4 P1.5', *lines[:110])
        client.wait(lambda: client.frame['v_um_s'] > 200_000 or client.frame['state'] in (2, 3))
        if client.frame['state'] == 1:
            return
    raise RuntimeError(f'the bead does not run: {client.lines[-4:]}')


@contextmanager
def meanwhile(step: Callable[[], None]) -> Iterator[None]:
    """Does a step again and again, in a thread."""
    over = threading.Event()

    def run() -> None:
        while not over.is_set():
            step()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def value_held(client) -> Iterator[None]:
    """Overrides as `process_control` has them sent, never twice the same."""
    sent = due = 0

    def send() -> None:
        nonlocal sent, due
        time.sleep(0.01)
        now = client.frame['t_us']
        if now >= due and client.frame['v_um_s']:
            sent, due = sent + 1, now + OVERRIDE_US
            client.text(f'$V {1000 - sent % 3} {1000 - sent % 3}')

    with meanwhile(send):
        yield
    print(f'firmware: {sent} overrides', file=sys.stderr)


def drain(board) -> None:
    """Reads the port of the plant: full of reports, it would stop the emulator when a late host makes the bead begin
    again."""
    if select.select([board.plant], [], [], 0.05)[0]:
        board.said += os.read(board.plant, 4096).decode()


def worst_case(board, shaper: tuple[str, ...]) -> dict[str, float]:
    """The busiest 0.1 s while a queue, filled during a dwell with the arc on, runs off at top speed."""
    board.client.wait(lambda: board.client.frame)
    heard = len(board.heard)
    board.fault('r')  # reports on
    with value_held(board.client), meanwhile(lambda: drain(board)):
        burn(board, [f'G1 X{i} Y{i} Z{190 - i / 2} F60000' for i in range(1, 111)], shaper)
        board.client.wait(lambda: board.client.frame['v_um_s'] == 0)
    tracked = [line for line in board.client.lines if line.startswith(('D ', '! RUN E212'))][-1]
    pins = board.pins()
    runs = [stretch(r) for r in re.findall(r'load ([-0-9a-z ]+)\n', board.heard[heard:])]
    worst = max(runs[1:], key=lambda r: r['busy'] / r['seconds'])
    worst['longest'] = max(r['longest'] for r in runs[1:])
    print(
        f'firmware: {shaper}: {worst} of {len(runs)} stretches, {pins}, {tracked}', file=sys.stderr
    )
    return worst


def worse(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
    """The busier of two runs, with the longest tick of both."""
    busier = max(a, b, key=lambda r: r['busy'] / r['seconds'])
    return busier | {'longest': max(a['longest'], b['longest'])}


def sizes(folder: Path) -> tuple[int, int]:
    """Flash and RAM of the image for the board, bytes."""
    out = subprocess.run(
        [str(PACKAGE / 'stm32/build.sh'), str(folder)], check=True, capture_output=True, text=True
    ).stdout
    row = re.search(r'^waam_stm32f407 +(\d+) \(.*\) +(\d+) \(', out, re.MULTILINE)
    return int(row[1]), int(row[2])


def tools(*names: str):
    """The module that builds and emulates, or None when a program that it needs is not installed."""
    target = load('test_target')
    if absent := target.missing([*target.TOOLS, *names]):
        print(f'firmware.*: not installed: {absent}', file=sys.stderr)
        return None
    return target


def memory() -> None:
    if tools() is None:
        return
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        flash, ram = sizes(Path(scratch))
    emit('firmware.flash_bytes', flash, 'bytes', 'flash of the chip', CHIP_FLASH)
    emit('firmware.ram_bytes', ram, 'bytes', 'RAM of the chip', CHIP_RAM)


def processor() -> None:
    if (target := tools('qemu-system-arm')) is None:
        return
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        sizes(Path(scratch))  # builds the image for the emulator, too
        board = target.Emulator(Path(scratch) / 'waam_qemu.elf', load('conftest').Client)
        try:
            board.client.wait(lambda: board.client.frame)
            worst = worse(worst_case(board, NO_SHAPER), worst_case(board, SHAPER))
        finally:
            board.close()
    budget = CLOCK_HZ * worst['seconds'] / 100
    interrupts = (worst['busy'] - worst['tick']) / budget
    emit('firmware.isr_budget_pct', interrupts, '%', 'allowed', 65.0)
    emit('firmware.cpu_budget_pct', worst['busy'] / budget, '%', 'allowed', 65.0)
    longest = worst['longest'] / (CLOCK_HZ * 1e-5)
    emit('firmware.tick_longest_pct', longest, '%', 'one millisecond', 100.0)


FIGURES = {
    'firmware.isr_budget_pct': processor, 'firmware.cpu_budget_pct': processor, 'firmware.tick_longest_pct': processor,
    'firmware.flash_bytes': memory, 'firmware.ram_bytes': memory,
}  # fmt: skip
