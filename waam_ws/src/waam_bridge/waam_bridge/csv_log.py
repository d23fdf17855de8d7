"""The operator's log as CSV. Pure but for the file it is given."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TextIO

from .frames import Telemetry

COLUMNS = ('Timestamp', 'X_pos', 'Y_pos', 'Z_pos', 'Current_A', 'Voltage_V', 'Temp_C', 'Feed_Rate')

PERIOD_US = 100_000  # the 10 Hz of source 000


def row(t: Telemetry, ros_ns: int, temperature: float) -> str:
    """One row: UTC time, positions in mm (work), A, V, degrees Celsius (nan = unknown), travel feed in mm/min."""
    stamp = datetime.fromtimestamp(ros_ns // 1_000_000 / 1000, UTC).isoformat(
        timespec='milliseconds'
    )
    return (
        f'{stamp[:-6]}Z; {t.x_um / 1e3:.3f}; {t.y_um / 1e3:.3f}; {t.z_um / 1e3:.3f}; '
        f'{t.current_ma / 1e3:.1f}; {t.voltage_mv / 1e3:.2f}; {temperature:.1f}; {t.v_um_s * 0.06:.1f}'
    )


class CsvLog:
    """Writes rows at most every PERIOD_US of controller time."""

    def __init__(self, file: TextIO) -> None:
        self.temperature = float('nan')
        self._file, self._next_us = file, 0
        file.write('; '.join(COLUMNS) + '\n')

    def add(self, t: Telemetry, ros_ns: int) -> None:
        """Writes a row when one is due; ros_ns: ROS time of the frame."""
        if self._next_us - PERIOD_US <= t.t_us < self._next_us:
            return
        self._next_us = t.t_us + PERIOD_US
        self._file.write(row(t, ros_ns, self.temperature) + '\n')

    def close(self) -> None:
        """Closes the file; nothing may be added any more."""
        self._file.close()
