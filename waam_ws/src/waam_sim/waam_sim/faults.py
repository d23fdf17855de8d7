"""Faults that can be put into the cell while it runs. Times are the controller's, in seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


class FaultError(ValueError):
    """An unknown fault or a value outside its range; the text names both."""


@dataclass(frozen=True)
class FaultKind:
    """What `value` means, its limits, the value used when 0 is given; `timed`: value is a duration."""

    meaning: str
    low: float
    high: float
    default: float
    timed: bool


DIAL = 'emissivity_dial'  # what a person sets at the instrument stays set, whatever ends
KINDS = {
    'arc_loss': FaultKind('seconds without arc', 0.0, 3600.0, 0.3, True),
    'wire_slip': FaultKind('share of wire speed lost', 0.0, 1.0, 0.4, False),
    'wire_end': FaultKind('seconds until a new spool is threaded', 0.0, 3600.0, math.inf, True),
    'gas_loss': FaultKind('seconds without gas', 0.0, 3600.0, math.inf, True),
    'scanner_dropout': FaultKind('share of points lost', 0.0, 1.0, 0.5, False),
    'scanner_dead': FaultKind('seconds without profiles', 0.0, 3600.0, math.inf, True),
    'distance_dead': FaultKind('seconds without readings', 0.0, 3600.0, math.inf, True),
    'distance_stuck': FaultKind('seconds with a frozen reading', 0.0, 3600.0, math.inf, True),
    'distance_inverted': FaultKind('seconds with the wrong sign', 0.0, 3600.0, math.inf, True),
    'distance_drift': FaultKind('drift in m/s', -0.01, 0.01, 0.5e-3, False),
    'distance_unit': FaultKind('factor of what it says', 0.0, 1000.0, 1 / 25.4, False),
    'distance_dropout': FaultKind('share of readings lost', 0.0, 1.0, 0.1, False),
    'drive_fault': FaultKind('seconds with the FAULT of a drive', 0.0, 3600.0, 1.0, True),
    'pyrometer_stuck': FaultKind('seconds with a frozen reading', 0.0, 3600.0, math.inf, True),
    # what a person does at the cell
    'estop_pressed': FaultKind(
        'seconds with the emergency stop pressed', 0.0, 3600.0, math.inf, True
    ),
    'limit_pressed': FaultKind('seconds with a limit switch pressed', 0.0, 3600.0, math.inf, True),
    'test_current': FaultKind('A through the current sensor', -200.0, 200.0, 20.0, False),
    'test_voltage': FaultKind('V at the voltage sensor', 0.0, 60.0, 24.0, False),
    DIAL: FaultKind('factor on the emissivity of the pyrometer', 0.1, 10.0, 1.0, False),
    'warm_hand': FaultKind('K at the spot of the pyrometer', -50.0, 300.0, 10.0, False),
}


@dataclass
class Faults:
    """The faults in force: name -> value (shares) or end time (timed)."""

    active: dict[str, float] = field(default_factory=dict)

    def inject(self, name: str, value: float, now: float) -> str:
        """Starts a fault ('none' ends all); value 0 takes its default. Returns a sentence; raises FaultError."""
        if name == 'none':
            self.active = {n: v for n, v in self.active.items() if n == DIAL}
            return 'all faults ended'
        kind = KINDS.get(name)
        if kind is None:
            raise FaultError(f"unknown fault '{name}'; known are {', '.join(KINDS)}, none")
        if not (kind.low <= value <= kind.high):
            raise FaultError(
                f"fault '{name}': value {value} ({kind.meaning}) must lie in {kind.low} .. {kind.high}"
            )
        value = value or kind.default
        self.active[name] = now + value if kind.timed else value
        lasting = kind.timed and math.isinf(value)
        return f"{name}: {'until ended' if lasting else f'{value:g} ({kind.meaning})'}"

    def on(self, name: str, now: float) -> bool:
        """Whether a timed fault is in force; one that is over is forgotten."""
        end = self.active.get(name)
        if end is None:
            return False
        if now >= end:
            del self.active[name]
            return False
        return True

    def share(self, name: str) -> float:
        """Value of a share fault, 0 when not in force."""
        return self.active.get(name, 0.0)
