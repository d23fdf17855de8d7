"""The image of the real board in QEMU, stopped and looked at through QEMU's debugger port (GDB's remote protocol).

QEMU has the core, the interrupt controller and the timers of the chip. Other registers read 0; what is written to them
is in its log. So code that waits for hardware has to be passed over, and what the board is told can be checked.
"""

from __future__ import annotations

import re
import socket
import subprocess
import time
from pathlib import Path

PC, XPSR, LR = 15, 25, 14
STORE = bytes.fromhex('0860fee7')  # str r0, [r1]; then a loop on the spot
PATIENCE = 90.0  # s of wall time; seconds on a busy computer


def symbols(image: Path) -> dict[str, int]:
    """Addresses of the image's functions and variables, without the bit that says Thumb."""
    listing = subprocess.run(
        ['arm-none-eabi-nm', str(image)], capture_output=True, text=True, check=True
    ).stdout
    return {
        name: int(at, 16) & ~1
        for at, name in re.findall(r'^([0-9a-f]+) \w (\w+)$', listing, re.MULTILINE)
    }


class TargetDebugger:
    """Stopped at reset; `folder` is for the socket and the log."""

    def __init__(self, image: Path, folder: Path) -> None:
        self.symbols = symbols(image)
        self.log = folder / 'unimplemented.log'
        port = folder / 'gdb'
        self.process = subprocess.Popen(
            [
                'qemu-system-arm', '-M', 'netduinoplus2', '-nodefaults', '-display', 'none', '-kernel', str(image),
                '-S', '-gdb', f'unix:{port},server=on,wait=off', '-d', 'unimp', '-D', str(self.log),
            ]
        )  # fmt: skip
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(PATIENCE)
        end = time.monotonic() + PATIENCE
        while True:
            try:
                self._socket.connect(str(port))
                break
            except (FileNotFoundError, ConnectionRefusedError):
                assert self.process.poll() is None and time.monotonic() < end, 'QEMU did not start'
                time.sleep(0.02)
        self._got = b''
        self.ask('qXfer:features:read:target.xml:0,fff')  # before, registers have no numbers

    def ask(self, command: str) -> str:
        """A command and its answer."""
        self._socket.sendall(f'${command}#{sum(command.encode()) & 0xFF:02x}'.encode())
        while not (found := re.search(rb'\$([^#]*)#..', self._got)):
            more = self._socket.recv(4096)
            assert more, 'QEMU has ended'
            self._got += more
        self._got = self._got[found.end() :]
        self._socket.sendall(b'+')
        return found[1].decode()

    def read(self, address: int) -> int:
        """A word of memory or of a register of the chip."""
        return int.from_bytes(bytes.fromhex(self.ask(f'm{address:x},4')), 'little')

    def register(self, number: int) -> int:
        """Of the core: R0 to R12, LR, PC, XPSR."""
        return int.from_bytes(bytes.fromhex(self.ask(f'p{number:x}')), 'little')

    def set(self, number: int, value: int) -> None:
        """A register of the core."""
        assert self.ask(f'P{number:x}={value.to_bytes(4, "little").hex()}') == 'OK'

    def run_to(self, name: str) -> None:
        """Goes on until the function is entered."""
        at = self.symbols[name]
        assert self.ask(f'Z1,{at:x},2') == 'OK'
        assert self.ask('c').startswith('T05')
        assert self.ask(f'z1,{at:x},2') == 'OK'
        assert self.register(PC) == at

    def return_with(self, value: int) -> None:
        """Leaves the function that was just entered, with this result and nothing done."""
        self.set(0, value)
        self.set(PC, self.register(LR) & ~1)

    def store(self, address: int, value: int, free: int) -> None:
        """Lets the core write a word: the debugger itself reaches memory only. free: RAM for two instructions."""
        self.ask(f'M{free:x},4:{STORE.hex()}')
        self.set(0, value)
        self.set(1, address)
        self.set(PC, free)
        self.ask('s')

    def step_to_a_loop(self, most: int = 1000) -> int:
        """Instruction by instruction to one that jumps to itself; its address."""
        at = self.register(PC)
        for _ in range(most):
            self.ask('s')
            before, at = at, self.register(PC)
            if before == at:
                return at
        raise AssertionError(f'no endless loop within {most} instructions; now at {at:#x}')

    def written(self, device: str, offset: int) -> list[int]:
        """What was written to a register that QEMU does not have."""
        text = self.log.read_text()
        pattern = rf'^{device}: unimplemented device write \(size 4, offset 0x0*{offset:x}, value 0x([0-9a-f]+)\)'
        return [int(v, 16) for v in re.findall(pattern, text, re.MULTILINE)]

    def close(self) -> None:
        """Ends QEMU."""
        self._socket.close()
        self.process.kill()
        self.process.wait()
