"""Cells as they were delivered, drawn from seeds: every one is a little off, some are connected wrongly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEPS = 320.0  # per mm, of the controller
# wiring fault -> the step that must find it, parameters of the simulated cell of which one is taken
FAULTS: dict[str, tuple[str, tuple[dict, ...]]] = {
    'estop': ('estop', ({'delivered_estop': 'reversed'}, {'delivered_estop': 'unwired'})),
    'limits': ('limits', ({'delivered_limits': 'open'}, {'delivered_limits': 'bridged'})),
    'gas': ('gas', ({'delivered_gas_valve': 'stuck_open'}, {'delivered_gas_valve': 'stuck_closed'})),
    'current': ('signals', ({'delivered_current_scale': -1.0},)),
    'thermocouple': ('temperature', ({'delivered_thermocouple_swapped': True},)),
    'axes': ('directions', ({'delivered_x_reversed': True}, {'delivered_y_reversed': True},
                            {'delivered_z_reversed': True}, {'delivered_xy_swapped': True})),
}  # fmt: skip
LAST_BEFORE_ARC = 'wire'  # where all of them have been looked for
ALLOWED_SKEW = 0.2  # deg, of a cell that is called healthy: a job runs with 0.25
SCANNER_M, SCANNER_DEG, SCANNER_S = 5e-3, 2.0, 0.08
DRAWN_M = np.array([0.060, 0.0, 0.120])  # the scanner on the drawing
SCANNER = 'delivered_scanner_'


@dataclass(frozen=True)
class Hidden:
    """parameters: of the node `cell`; machine_steps: per mm; faults: by name."""

    seed: int
    parameters: dict
    machine_steps: tuple[float, float, float]
    faults: tuple[str, ...]

    def mended(self, fault: str) -> Hidden:
        """The same cell after somebody has seen to it."""
        names = {name for choice in FAULTS[fault][1] for name in choice}
        left = {k: v for k, v in self.parameters.items() if k not in names}
        rest = tuple(f for f in self.faults if f != fault)
        return Hidden(self.seed, left, self.machine_steps, rest)

    @property
    def scanner_m(self) -> np.ndarray:
        """(3,) where the scanner truly sits."""
        return DRAWN_M + [self.parameters[SCANNER + axis] for axis in 'xyz']

    @property
    def scanner_rotation(self) -> np.ndarray:
        """(3, 3) of the scanner, x along its line, z up, in the work frame."""
        angles = np.radians([self.parameters[SCANNER + n] for n in ('yaw', 'pitch', 'roll')])
        turned = np.eye(3)
        for axis, angle in zip((2, 1, 0), angles, strict=True):
            turned = turned @ _about(axis, angle)
        return turned @ _about(2, np.pi / 2)


def _about(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out[a, a], out[a, b], out[b, a], out[b, b] = c, -s, s, c
    return out


def drawn(seed: int, faults: int) -> Hidden:
    """steps +-3 %, wheel +-4.5 %, scales of sensors +-5 %, squareness within what a job takes, scanner +-5 mm and
    +-2 deg, its clock +-80 ms, wire delay 10 to 90 ms and lag 20 to 200 ms, emissivity 0.6 to 0.95, modes from 26 to 60
    Hz; and so many faults."""
    rng = np.random.default_rng(seed)
    steps = tuple(round(float(v), 3) for v in STEPS * rng.uniform(0.97, 1.03, 3))
    parameters = {
        'arc_wire_ratio': float(rng.uniform(0.957, 1.045)),
        'delivered_skew': float(rng.uniform(-ALLOWED_SKEW, ALLOWED_SKEW)),
        'delivered_current_scale': float(rng.uniform(0.95, 1.05)),
        'delivered_voltage_scale': float(rng.uniform(0.95, 1.05)),
        'arc_wire_delay': float(rng.uniform(0.01, 0.09)),
        'arc_wire_lag': float(rng.uniform(0.02, 0.2)),
        'pyrometer_emissivity': float(rng.uniform(0.6, 0.95)),
        'gantry_on': True,
        'gantry_x_hz': float(rng.uniform(26.0, 60.0)),
        'gantry_y_hz': float(rng.uniform(26.0, 60.0)),
        SCANNER + 'late': float(rng.uniform(-SCANNER_S, SCANNER_S)),
    }
    parameters |= {SCANNER + a: float(rng.uniform(-SCANNER_M, SCANNER_M)) for a in 'xyz'}
    names = ('roll', 'pitch', 'yaw')
    parameters |= {SCANNER + n: float(rng.uniform(-SCANNER_DEG, SCANNER_DEG)) for n in names}
    chosen = tuple(str(n) for n in rng.choice(list(FAULTS), faults, replace=False))
    for name in chosen:
        choices = FAULTS[name][1]
        parameters |= choices[int(rng.integers(len(choices)))]
    return Hidden(seed, parameters, steps, chosen)  # type: ignore[arg-type]
