"""The firmware of the STM32F407, built with Debian's compiler and run under QEMU.

board_qemu.c stands in for the board; the plant port of these tests is its USART1 (small letter: fault, capital: end).
"""

from __future__ import annotations

import os
import re
import select
import shutil
import struct
import subprocess
import time
import tty
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest
from target_debugger import LR, XPSR, TargetDebugger

PACKAGE = Path(__file__).parents[1]
IDLE, RUN, HOLD, ALARM = range(4)
ARC, ESTABLISHED, HOMED, WIRE_JOG = 1, 2, 8, 128
STEPS_PER_MM, WIRE_STEPS_PER_MM = 320, 50
TOOLS = ['arm-none-eabi-gcc', 'arm-none-eabi-size', 'cmake']


def missing(tools: list[str]) -> str:
    return ', '.join(t for t in tools if not shutil.which(t))


@pytest.fixture(scope='module')
def images(controller_path) -> Path:
    """The folder of the images, kept beside the other build results; only what changed is compiled again."""
    if absent := missing(TOOLS):
        pytest.skip(f'not installed: {absent}')
    folder = controller_path.resolve().parent / 'stm32'
    script = str(PACKAGE / 'stm32/build.sh')
    built = subprocess.run(
        [script, str(folder)], check=False, capture_output=True, text=True, timeout=300
    )
    assert built.returncode == 0, built.stderr
    (folder / 'sizes.txt').write_text(built.stdout)
    return folder


class Emulator:
    """QEMU with the firmware. -icount makes it count: 8 ns per instruction, never faster than real time; and when the
    computer is busy, the controller's time is to stand still rather than the host's."""

    def __init__(self, image: Path, client_class: type) -> None:
        class PatientClient(client_class):
            def wait(self, condition, timeout=10.0):
                return super().wait(condition, max(timeout, 90.0))  # emulation on a busy computer

        self.process = subprocess.Popen(
            [
                'qemu-system-arm',
                '-M',
                'netduinoplus2',
                '-nodefaults',
                '-display',
                'none',
            ]
            + ['-kernel', str(image), '-icount', 'shift=3,align=on']
            + ['-chardev', 'pty,id=plant', '-chardev', 'pty,id=link']
            + ['-serial', 'chardev:plant', '-serial', 'chardev:link'],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        paths: dict[str, str] = {}
        while len(paths) < 2:
            line = self.process.stdout.readline()
            assert line, 'QEMU ended before it had opened its terminals'
            if found := re.search(r'redirected to (\S+) \(label (\w+)\)', line):
                paths[found[2]] = found[1]
        self.plant = os.open(paths['plant'], os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.plant)
        self.said = self.heard = ''
        self.client = PatientClient(paths['link'])

    def hear(self, pattern: str, question: bytes = b'') -> re.Match[str]:
        """Next thing that the plant port says; what comes before it counts as heard. The question is repeated."""
        end = time.monotonic() + 90.0
        while not (found := re.search(pattern, self.said)):
            assert time.monotonic() < end, f'not heard: {pattern}; said {self.said!r}'
            if select.select([self.plant], [], [], 2.0)[0]:
                self.said += os.read(self.plant, 4096).decode()
            else:
                os.write(self.plant, question)
        self.heard += self.said[: found.end()]
        self.said = self.said[found.end() :]
        return found

    def fault(self, letters: str) -> None:
        """Waits until the firmware has read them."""
        before = self.pins()['changes']
        for letter in letters:
            os.write(self.plant, letter.encode())
        while self.pins()['changes'] < before + len(letters):
            pass

    def pins(self) -> dict[str, int]:
        """Pulses given out, arc and gas outputs, source setpoint, late ticks, faults made or ended."""
        os.write(self.plant, b'?')
        names = ['x', 'y', 'z', 'wire', 'arc', 'gas', 'setpoint_mv', 'late', 'changes', 'drives']
        values = self.hear(r'pins ([-0-9 ]+)\n', b'?')[1].split()
        return dict(zip(names, map(int, values), strict=True))

    def pins_at_rest(self) -> dict[str, int]:
        """When all pulses have been given out, some milliseconds after the controller has come to its end."""
        pins = self.pins()
        while (later := self.pins()) != pins:
            pins = later
        return pins

    def wait_in_run(self, condition: Callable[[], bool]) -> None:
        """A host that is late loses the link (201), as it must, and goes on."""
        while not condition():
            self.client.wait(lambda: condition() or self.client.frame['state'] == HOLD)
            if self.client.frame['state'] == HOLD:
                assert self.client.frame['fault'] == 201
                self.client.ask('$R')
                self.client.next_frame()

    def burn(self) -> None:
        """A bead under way. A host that was late lost the arc or the link, as it must, and tries again."""
        client = self.client
        client.lease = True
        for _ in range(5):
            assert client.ask('$A target') == '$A ok'
            client.send('M3 W3000 S22', 'G1 X40 F600')
            client.wait(
                lambda: client.frame['flags'] & ESTABLISHED or client.frame['state'] == HOLD
            )
            if client.frame['flags'] & ESTABLISHED:
                return
            assert client.frame['fault'] in (201, 202)
            client.ask('$S')
            client.wait(lambda: client.frame['state'] == IDLE)
            client.ask(f'$L {client.sequence + 1}')
        pytest.fail('the arc could not be held')

    def close(self) -> None:
        self.client.close()
        self.process.kill()
        self.process.wait()
        os.close(self.plant)
        self.process.stdout.close()


def need_emulator() -> None:
    if absent := missing(['qemu-system-arm']):
        pytest.skip(f'not installed: {absent}')
    machines = subprocess.run(['qemu-system-arm', '-M', 'help'], capture_output=True, text=True)
    if 'netduinoplus2' not in machines.stdout:
        pytest.skip('this QEMU has no machine netduinoplus2')


@pytest.fixture(scope='module')
def emulator(images, client_class) -> Iterator[Emulator]:
    need_emulator()
    emulator = Emulator(images / 'waam_qemu.elf', client_class)
    yield emulator
    emulator.close()


@pytest.fixture
def board(emulator) -> Emulator:
    """Without faults, IDLE, homed, work frame at the machine's zero; booted only once, for that takes its time."""
    client = emulator.client
    client.heartbeat, client.lease = True, False
    client.wait(lambda: client.frame)
    if client.next_frame()['state'] == ALARM:
        client.ask('$X')
    client.ask('$S')
    client.wait(lambda: client.frame['state'] == IDLE)
    client.identify()
    client.sequence = client.accepted = 0
    if not client.next_frame()['flags'] & HOMED:
        client.run('G28')
    client.run('G0 X0 Y0')
    return emulator


def test_usb_port_forgets_a_host_that_goes():
    """port_usb.c on the host, with a USB device that the program plays."""
    program = PACKAGE.parents[1] / 'build/waam_firmware/usb_port_properties'
    if not program.exists():
        pytest.skip(f'{program.name} was not built (BUILD_TESTING)')
    done = subprocess.run([program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout


def steps(pins: dict[str, int]) -> list[int]:
    return [pins[axis] for axis in 'xyz']


def test_image_fits_and_starts_where_the_processor_looks(images):
    sizes = (images / 'sizes.txt').read_text()
    rows = re.findall(r'^(waam_\w+) +(\d+) .* +(\d+) \(', sizes, re.MULTILINE)
    assert {name for name, _, _ in rows} == {'waam_stm32f407', 'waam_qemu'}
    assert all(int(flash) < 1 << 20 and int(ram) < 128 << 10 for _, flash, ram in rows)
    stack, reset, *handlers = struct.unpack(
        '<98I', (images / 'waam_stm32f407.bin').read_bytes()[: 98 * 4]
    )
    assert stack == 0x2002_0000
    flash = next(int(f) for name, f, _ in rows if name == 'waam_stm32f407')
    assert all(a & 1 and 0x0800_0000 < a < 0x0800_0000 + flash for a in (reset, *handlers))


def test_pins_are_switched_by_the_set_and_reset_register_alone():
    """Reading and writing the whole port (ODR ^= ...) loses what an interrupt switches off in between: the arc."""
    sources = {f.name: f.read_text() for f in sorted((PACKAGE / 'stm32').glob('*.c'))}
    assert 'BSRR = ' in sources['board_stm32.c']
    assert {name for name, text in sources.items() if re.search(r'\bODR\b', text)} == set()
    assert not re.search(r'BSRR\s*[|&^]=', ''.join(sources.values()))


def test_interrupts_use_no_double_precision(images):
    """The processor has no double unit: a call of the emulation has no place in what runs 80 000 times per second."""
    listing = subprocess.run(
        ['arm-none-eabi-objdump', '-d', str(images / 'waam_stm32f407.elf')],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    bodies = dict(re.findall(r'<(\w+)>:\n((?:.+\n)+)', listing))
    todo = ['TIM3_IRQHandler', 'TIM2_IRQHandler', 'USART2_IRQHandler']
    seen: set[str] = set()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        assert not name.startswith(('__aeabi_d', '__aeabi_ui2d', '__aeabi_i2d', '__aeabi_f2d')), (
            seen
        )
        todo += re.findall(r'\sbl?(?:\.w)?\s+\w+ <(\w+)>', bodies[name])
    assert {'waam_core_fast', 'board_sample', 'board_direction', 'load_end'} <= seen


def test_identifies_itself(board):
    answer = board.client.identify()
    assert (
        answer.startswith('$I WAAM_CONTROLLER_V1 fw=') and ' clk=free blocks=64 rx=2048 ' in answer
    )
    assert board.client.bad_checks == 0


def test_streams_and_gives_out_every_pulse(board):
    client = board.client
    start = steps(board.pins_at_rest())
    lines = [f'G1 X{0.2 * (i + 1):.3f} Y{0.002 * (i + 1):.3f} F3000' for i in range(250)]
    client.run('G0 Z198', *lines, timeout=120)
    frame = client.next_frame()
    assert (frame['x_um'], frame['y_um'], frame['z_um']) == (50_000, 500, 198_000)
    moved = [b - a for a, b in zip(start, steps(board.pins_at_rest()), strict=True)]
    assert moved == [50 * STEPS_PER_MM, STEPS_PER_MM // 2, -2 * STEPS_PER_MM]
    client.run('G0 Z200')
    assert client.bad_checks == 0


def test_line_with_a_bad_check_is_asked_for_again(board):
    client = board.client
    last = client.sequence
    start = len(client.lines)
    client.raw(b'N%d G0 X300*12345\n' % (last + 1))
    assert client.wait_line('^rs', start) == f'rs N{last + 1} E100'
    client.numbered(last + 3, 'G0 X3')
    client.wait_line(f'^rs N{last + 1} E10', start)
    client.run('G0 X1', 'G0 X2')
    client.numbered(last + 2, 'G0 X9')
    client.wait(lambda: sum(x.startswith(f'ok N{last + 2} ') for x in client.lines[start:]) == 2)
    assert client.next_frame()['x_um'] == 2_000


def test_hold_and_resume(board):
    client = board.client
    client.send('G1 X30 F1200', 'G1 X30 Y2')
    client.wait(lambda: client.frame['x_um'] > 2_000)
    client.ask('$P')
    client.wait(lambda: client.frame['state'] == HOLD and client.frame['v_um_s'] == 0)
    stood = client.next_frame()['x_um']
    assert client.next_frame()['x_um'] == stood < 30_000
    client.ask('$V 2000 1000')
    client.ask('$R')
    client.wait(lambda: client.frame['v_um_s'] == 40_000)
    client.ask('$V 1000 1000')
    client.wait(lambda: client.frame['state'] == IDLE)
    assert (client.frame['x_um'], client.frame['y_um']) == (30_000, 2_000)


def test_wire_is_the_fourth_axis(board):
    client = board.client
    before = board.pins_at_rest()['wire']
    client.ask('$W 10 3000')
    client.wait(lambda: client.frame['flags'] & WIRE_JOG)
    client.wait(lambda: not client.frame['flags'] & WIRE_JOG)
    client.next_frame()
    assert board.pins_at_rest()['wire'] - before == pytest.approx(10 * WIRE_STEPS_PER_MM, rel=0.03)


def test_arc_burns_for_a_bead_and_ends_with_the_lease(board):
    client = board.client
    board.burn()
    pins = board.pins()
    assert pins['arc'] == pins['gas'] == 1 and pins['setpoint_mv'] > 0
    steady = client.frame['t_us'] + 800_000  # 0.3 s fixed gains, then scheduled ones
    client.wait(lambda: client.frame['t_us'] > steady)
    if client.frame['flags'] & ARC:  # the host kept up
        assert board.pins()['setpoint_mv'] == pytest.approx(22_000, abs=3_000)  # the ripple's share
        assert client.frame['voltage_mV'] == pytest.approx(22_000, abs=500)
    frozen = len(client.frames)
    client.frozen_lease, client.lease = client.frame['t_us'], 'frozen'
    client.wait(lambda: client.frame['fault'] == 202)
    client.wait(lambda: not client.frame['flags'] & ARC)
    # of the frame that said it first: a busy computer looks later
    off = next(f['t_us'] for f in client.frames[frozen:] if not f['flags'] & ARC)
    assert off - client.frozen_lease <= 500_000 + 10_000  # one telemetry period
    pins = board.pins()
    assert pins['arc'] == pins['setpoint_mv'] == 0


@pytest.mark.parametrize('sensor', ['k', 'j', 'v'])
def test_a_reading_at_the_end_of_the_converters_range_is_an_alarm(board, sensor):
    """Arc current at either end of the range, arc voltage at the upper one: 4095 counts is no measurement."""
    client = board.client
    board.burn()
    board.fault(sensor)
    client.wait(lambda: client.frame['state'] == ALARM)
    assert client.next_frame()['fault'] == 303
    board.fault(sensor.upper())
    assert board.pins()['arc'] == 0


def test_silent_host_is_noticed(board):
    client = board.client
    client.send('G1 X300 F1200')
    client.wait(lambda: client.frame['x_um'] > 500)
    client.heartbeat = False
    assert client.wait_line('^! HOLD E201', len(client.lines) - 1)
    client.wait(lambda: client.frame['v_um_s'] == 0)


def test_emergency_stop_blocks_all_outputs(board):
    client = board.client
    board.burn()
    board.fault('e')
    client.wait(lambda: client.frame['state'] == ALARM)
    assert client.next_frame()['fault'] == 300
    stopped = board.pins_at_rest()
    assert stopped['arc'] == stopped['setpoint_mv'] == stopped['drives'] == 0
    assert client.ask('$X').startswith('$X error E300')
    board.fault('E')
    assert client.ask('$X') == '$X ok'
    assert board.pins_at_rest()['drives'] == 1
    assert (
        steps(board.pins_at_rest()) == steps(stopped) and not client.next_frame()['flags'] & HOMED
    )


def test_nothing_happens_when_the_counters_of_the_main_loop_wrap(images, client_class):
    """After 49.7 days (ticks, segments) and 42.9 km of wire; the image of this test begins shortly before that.

    A loop that divides its count of 10 kHz ticks by ten is late by 2^32 / 10 ticks after 119.3 hours: ALARM 303."""
    need_emulator()
    board = Emulator(images / 'waam_qemu_wrap.elf', client_class)
    client = board.client
    try:
        client.heartbeat = True
        client.wait(lambda: client.frame)
        assert client.ask('$X') == '$X ok'
        client.identify()
        wire = board.pins_at_rest()['wire']
        assert wire == 2**31 - 1 - 300
        client.run('G28')
        start = steps(board.pins_at_rest())
        first = client.frame['t_us']
        assert first < 11_000_000, 'the wrap, 12 s after the start, is to fall into the move'
        client.send('G1 X100 F600', 'G1 X0 Y10')
        board.wait_in_run(lambda: client.frame['t_us'] > 13_000_000)
        assert client.frame['state'] == RUN
        client.ask('$V 2000 1000')
        board.wait_in_run(lambda: client.frame['state'] == IDLE)
        assert (client.frame['x_um'], client.frame['y_um']) == (0, 10_000)
        moved = [b - a for a, b in zip(start, steps(board.pins_at_rest()), strict=True)]
        assert moved == [0, 10 * STEPS_PER_MM, 0]
        client.ask('$W 20 3000')
        client.wait(lambda: client.frame['flags'] & WIRE_JOG)
        client.wait(lambda: not client.frame['flags'] & WIRE_JOG)
        fed = (board.pins_at_rest()['wire'] - wire) % 2**32
        assert fed == pytest.approx(20 * WIRE_STEPS_PER_MM, rel=0.03)
        assert not [line for line in client.lines if 'ALARM' in line and 'E306' not in line]
        assert client.bad_checks == 0
    finally:
        board.close()


def test_hanging_main_loop_is_reset_and_says_that_it_is_new(board):
    """The watchdog is fed only when tick, fast tick and link loop have run; here only interrupts go on."""
    client = board.client
    boot = re.search(r' boot=(\d+) ', client.identify())[1]
    client.sequence = client.accepted = 0
    client.send('G1 X300 F1200')
    client.wait(lambda: client.frame['x_um'] > 500)
    os.write(board.plant, b'h')
    board.hear('watchdog reset')
    count = len(client.frames)
    client.wait(lambda: any(f['seq'] < 5 for f in client.frames[count:]))
    assert re.search(r' boot=(\d+) ', client.identify())[1] != boot
    frame = client.next_frame()
    assert (frame['state'], frame['fault']) == (ALARM, 307)
    assert not frame['flags'] & (HOMED | ARC) and frame['v_um_s'] == 0


def after_the_reset(board: Emulator, letter: str, patience: float = 90.0) -> str:
    """Makes a fault, waits for the watchdog, and asks the new start why: its line."""
    client = board.client
    count = len(client.frames)
    os.write(board.plant, letter.encode())
    board.hear('watchdog reset')
    client.wait(lambda: any(f['seq'] < 5 for f in client.frames[count:]), patience)
    start = len(client.lines)
    client.identify()
    return client.wait_line('^! ALARM', start)


def function_at(images: Path, address: str) -> str:
    listing = subprocess.run(
        ['arm-none-eabi-addr2line', '-f', '-i', '-e', str(images / 'waam_qemu.elf'), address],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    return ' '.join(listing.split()[::2])


def test_arc_goes_off_20_ms_after_the_last_tick_and_the_reset_is_explained(board, images):
    """The main loop hangs with the arc on. The orders of its last tick hold for 20 ms, the watchdog waits for 500."""
    board.burn()
    line = after_the_reset(board, 'h')
    after = int(re.search(r'(\d+) fast ticks, then the arc went off', board.heard)[1])
    assert 195 <= after <= 200, 'counted from where the watchdog is fed, right after a tick'
    told = re.match(r'! ALARM E307 the main loop stood still: pc ([0-9a-f]{8}) lr', line)
    assert told, line
    assert 'board_feed_watchdog' in function_at(images, told[1])
    frame = board.client.next_frame()
    assert (frame['state'], frame['fault']) == (ALARM, 307)
    assert board.pins()['arc'] == 0


def test_main_loop_that_stands_still_for_50_ms_is_an_alarm_of_its_own(board):
    client = board.client
    board.burn()
    start = len(client.lines)
    os.write(board.plant, b'i')
    assert '309 the controller' in client.wait_line('^! ALARM', start)
    assert re.search(r'(19[5-9]|200) fast ticks, then the arc went off', board.heard + board.said)
    assert board.pins()['arc'] == 0 and client.next_frame()['fault'] == 309
    assert client.ask('$X') == '$X ok'


@pytest.mark.parametrize(
    ('letter', 'cause', 'place'),
    [
        ('u', 'undefined instruction', 'break_down'),
        ('b', 'bad address', 'break_down'),
        ('o', 'stack overflow', ''),
        ('n', 'the crystal stopped', ''),
        ('x', 'bad address', 'board_arc'),
    ],
)
def test_a_fault_is_explained_after_the_reset(board, images, letter, cause, place):
    """Undefined instruction, bad address, stack that overflows, clock security, bad address in an interrupt."""
    board.burn()
    line = after_the_reset(board, letter)
    told = re.match(rf'! ALARM E307 {cause}: pc (\w+) lr (\w+) cfsr ([0-9a-f]{{8}}) hfsr', line)
    assert told, line
    if place:
        assert place in function_at(images, told[1])
    assert (int(told[3], 16) != 0) == (letter != 'n')
    if letter in 'bx':
        assert ' address a0000000 ' in line
    assert board.pins()['arc'] == 0
    start = len(board.client.lines)
    assert board.client.ask('$X') == '$X ok'
    board.client.identify()
    assert not [x for x in board.client.lines[start:] if 'E307' in x], 'told until the reset'


def test_accelerometer_gives_3200_samples_a_second_until_it_is_torn_off(board):
    """The driver of the board against a simulated ADXL345; its SPI and DMA are the real board's alone."""
    client = board.client
    assert 'ACCEL' in client.identify()
    client.lines.clear()
    assert client.ask('$M 1') == '$M ok'
    client.wait(lambda: sum(line.startswith('A ') for line in client.lines) > 60)
    told = [line[2:].split(',', 3) for line in client.lines if line.startswith('A ')]
    assert [int(f[0]) for f in told] == list(range(len(told)))
    assert {f[2] for f in told} == {'0'} and {len(f[3]) for f in told} == {16 * 7}
    took = (int(told[-1][1]) - int(told[0][1])) * 1e-6
    assert 16 * (len(told) - 1) / took == pytest.approx(3200, rel=0.01)
    board.fault('a')
    client.wait(lambda: any('E213' in line for line in client.lines))
    assert [line for line in client.lines if line.startswith('!')] == [
        '! IDLE E213 accelerometer: the ADXL345 was lost'
    ]
    board.fault('A')
    assert client.ask('$M 0') == '$M ok'


# ---- the supply detector, on the image of the real board ----


@pytest.fixture
def debugger(images, tmp_path) -> Iterator[TargetDebugger]:
    """The image of the real board, which QEMU has no machine for, at the begin of its main loop."""
    need_emulator()
    debugger = TargetDebugger(images / 'waam_stm32f407.elf', tmp_path)
    debugger.run_to('clock_init')
    debugger.return_with(0)  # there is no crystal to wait for
    debugger.run_to('board_start_timers')
    debugger.return_with(0)  # those of QEMU have a clock of their own
    debugger.run_to('port_serve')
    yield debugger
    debugger.close()


EXTI_IMR, EXTI_RTSR = 0x4001_3C00, 0x4001_3C08
NVIC_ISER, NVIC_ISPR, NVIC_IPR = 0xE000_E100, 0xE000_E200, 0xE000_E400
TIM3_CCER, TIM4_CCR1, TIM4_CCR2 = 0x4000_0420, 0x4000_0834, 0x4000_0838
IRQ_PVD, PVD_LINE, GPIOE_BSRR = 1, 1 << 16, 0x18
ARC_GAS_DRIVES_SENSE = 1 << 2 | 1 << 3 | 1 << 8 | 1 << 12  # pins of port E


def test_supply_detector_is_armed_at_its_highest_level(debugger):
    """RM0090: PWR_CR has the level in bits 7:5 (111 = 2.9 V) and the enable in bit 4; its output is EXTI line 16."""
    assert debugger.written('PWR', 0)[-1] & 0xF0 == 0xF0
    assert debugger.read(EXTI_IMR) & PVD_LINE and debugger.read(EXTI_RTSR) & PVD_LINE
    assert debugger.read(NVIC_ISER) & 1 << IRQ_PVD
    assert debugger.read(NVIC_IPR) >> 8 * IRQ_PVD & 0xFF == 0  # nothing is more urgent


def test_brown_out_switches_everything_off_and_waits_for_the_watchdog(debugger):
    """QEMU's supply never falls, so the interrupt is made pending by hand; all that follows is the board's code."""
    free = debugger.symbols['_stack_bottom']  # the stack does not reach down to there
    running = {TIM3_CCER: 0x1111, TIM4_CCR1: 1000, TIM4_CCR2: 1500}  # step pulses, wire, voltage
    for register, value in running.items():
        debugger.store(register, value, free)
        assert debugger.read(register) == value
    before = len(debugger.written('GPIOE', GPIOE_BSRR))
    debugger.store(NVIC_ISPR, 1 << IRQ_PVD, free)
    debugger.run_to('fault_handler')
    assert debugger.register(XPSR) & 0x1FF == 16 + IRQ_PVD
    loop = debugger.step_to_a_loop(20_000)  # the checksum of what is kept is on the way
    assert loop - debugger.symbols['board_await_reset'] in range(16)
    assert ARC_GAS_DRIVES_SENSE << 16 in debugger.written('GPIOE', GPIOE_BSRR)[before:]
    assert [debugger.read(r) for r in running] == [0, 0, 0]


# ---- what is kept over a reset

RECORD, MAGIC = struct.Struct('<8I'), 0x5746_4C54


def told_at_the_start(images: Path, folder: Path, record: bytes) -> str:
    """What the image says of the memory that it finds; '' for nothing."""
    debugger = TargetDebugger(images / 'waam_stm32f407.elf', folder)
    try:
        debugger.ask(f'M{debugger.symbols["record"]:x},{len(record):x}:{record.hex()}')
        debugger.run_to('clock_init')
        debugger.return_with(0)
        debugger.run_to('fault_take')
        debugger.symbols['back'] = debugger.register(LR) & ~1
        debugger.run_to('back')
        text = debugger.register(0)
        kept = debugger.ask(f'm{text:x},80') if text else ''
        assert debugger.read(debugger.symbols['record']) == 0 or not text, 'told once'
        return bytes.fromhex(kept).split(b'\0')[0].decode()
    finally:
        debugger.close()


def sealed(*words: int) -> bytes:
    body = struct.pack('<7I', *words)
    return body + struct.pack('<I', zlib.crc32(body))


def test_memory_after_a_cold_start_is_no_fault(images, tmp_path):
    """RAM comes up with anything in it: told is only what has the magic number and the right check."""
    need_emulator()
    random = Random(41)
    good = sealed(MAGIC, 6, 0x0800_1234, 0x0800_5679, 1 << 16, 0, 0xFFFF_FFFF)
    spoilt = bytearray(good)
    spoilt[9] ^= 4
    garbage = [random.randbytes(RECORD.size), MAGIC.to_bytes(4, 'little') + random.randbytes(28)]
    garbage += [bytes(RECORD.size), b'\xff' * RECORD.size, bytes(spoilt)]
    for number, record in enumerate(garbage):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert told_at_the_start(images, folder, record) == ''
    assert told_at_the_start(images, tmp_path, good) == (
        'undefined instruction: pc 08001234 lr 08005679 cfsr 00010000 hfsr 00000000 '
        'address unknown exception 6'
    )


def test_no_function_steps_over_the_guard_below_the_stack(images):
    """The guard is 2 KiB; the build refuses greater frames, so a stack that overflows touches it."""
    build = (PACKAGE / 'stm32/CMakeLists.txt').read_text()
    limit = int(re.search(r'-Wframe-larger-than=(\d+)', build)[1])
    names = subprocess.run(
        ['arm-none-eabi-nm', str(images / 'waam_stm32f407.elf')], capture_output=True, text=True
    ).stdout
    place = {n: int(a, 16) for a, n in re.findall(r'^(\w+) \w (_\w+)$', names, re.MULTILINE)}
    guard = place['_stack_bottom'] - place['_stack_guard']
    assert limit < guard == place['_guard_size'] and place['_stack_guard'] % guard == 0
