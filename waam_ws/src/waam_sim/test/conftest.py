"""A fake virtual controller (the listening end of the plant port) and cells for the tests."""

from __future__ import annotations

import socket
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim import part
from waam_sim.metal_params import MetalParams
from waam_sim.plant import Plant, PlantParams, warm_up

STEP, ANSWER = struct.Struct('<IIQ'), struct.Struct('<IIddddII')

sys.path.insert(0, str(Path(__file__).parent))  # helpers are importable by name


class FakeController:
    """Listens at `path`, moves a torch in straight lines (work frame, m) and logs every answer."""

    def __init__(
        self, path: str, zero=(0.100, 0.080, 0.020), time_us: int = 1_700_000_000_000_000
    ) -> None:
        self.path, self.zero, self.time_us = path, np.array(zero), time_us
        self.position = np.array([0.0, 0.0, 0.05])
        self.answers: list[tuple] = []
        self.felt = np.empty((0, 3))  # m/s^2, of the accelerometer in the last step
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(path)
        self._listener.listen(1)
        self._listener.settimeout(60.0)
        self.client: socket.socket | None = None

    def accept(self) -> None:
        self.client, _ = self._listener.accept()
        self.client.settimeout(10.0)

    def step(self, tips: np.ndarray, wire=0.0, voltage=0.0, outputs=0, magic=0x57414D53) -> tuple:
        """One step with the tip positions (10, 3) of its samples; returns (magic, inputs, A, V, m/s)."""
        samples = np.zeros(len(tips), SAMPLE)
        machine = np.asarray(tips) + self.zero
        samples['table_x'], samples['table_y'], samples['tool_z'] = (
            -machine[:, 0],
            -machine[:, 1],
            machine[:, 2],
        )
        samples['wire_cmd'], samples['voltage_set'], samples['outputs'] = wire, voltage, outputs
        self.time_us += 1000 * len(tips)
        self.client.sendall(STEP.pack(magic, len(tips), self.time_us) + samples.tobytes())
        self.answers.append(ANSWER.unpack(self._receive(ANSWER.size)))
        samples_of_accelerometer = self.answers[-1][-1]
        felt = self._receive(12 * samples_of_accelerometer)
        self.felt = np.frombuffer(felt, '<f4').reshape(-1, 3)
        self.position = np.asarray(tips)[-1]
        return self.answers[-1]

    def _receive(self, size: int) -> bytes:
        data = b''
        while len(data) < size:
            more = self.client.recv(size - len(data))
            if not more:
                raise ConnectionError('the cell hung up')
            data += more
        return data

    def run(self, to, seconds: float, **outputs) -> list[tuple]:
        """A straight line to `to` in `seconds`; the answers of its steps."""
        n = max(round(seconds * 100), 1)
        f = np.arange(1, 10 * n + 1)[:, None] / (10 * n)
        path = self.position + f * (np.asarray(to, float) - self.position)
        return [self.step(path[10 * i : 10 * i + 10], **outputs) for i in range(n)]

    def close(self) -> None:
        if self.client is not None:
            self.client.close()
        self._listener.close()


@pytest.fixture(scope='session', autouse=True)
def compiled():
    """Compiles the cores once, outside of any test's time limits."""
    warm_up()


@pytest.fixture
def controller(tmp_path):
    fake = FakeController(str(tmp_path / 'plant'))
    yield fake
    fake.close()


@pytest.fixture
def make_cell():
    """make_cell(size=(x, y, z) m, seed, noise=False, **parameters of the metal) -> Plant with a flat plate."""

    def make(size=(0.1, 0.06, 0.02), seed=1, noise=False, groups=None, **metal) -> Plant:
        quiet = (
            {} if noise else {'area_noise_fixed': 0.0, 'area_noise_layer': 0.0, 'width_noise': 0.0}
        )
        params = PlantParams(metal=MetalParams(**quiet, **metal), **(groups or {}))
        return Plant(part.plate(*size, params.metal.cell, params.metal.margin), params, seed)

    return make
