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
ALLOWED_SKEW = 0.2  # deg, of a cell that is called healthy: a job runs with 0.25


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


def drawn(seed: int, faults: int) -> Hidden:
    """steps +-3 %, wheel +-4.5 %, scales of sensors +-5 %, squareness within what a job takes, and so many faults."""
    rng = np.random.default_rng(seed)
    steps = tuple(round(float(v), 3) for v in STEPS * rng.uniform(0.97, 1.03, 3))
    parameters = {
        'arc_wire_ratio': float(rng.uniform(0.957, 1.045)),
        'delivered_skew': float(rng.uniform(-ALLOWED_SKEW, ALLOWED_SKEW)),
        'delivered_current_scale': float(rng.uniform(0.95, 1.05)),
        'delivered_voltage_scale': float(rng.uniform(0.95, 1.05)),
    }
    chosen = tuple(str(n) for n in rng.choice(list(FAULTS), faults, replace=False))
    for name in chosen:
        choices = FAULTS[name][1]
        parameters |= choices[int(rng.integers(len(choices)))]
    return Hidden(seed, parameters, steps, chosen)  # type: ignore[arg-type]
