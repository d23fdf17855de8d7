"""What the controller core commands in 1 ms, as the plant port has it (waam_firmware/doc/plant_port.md)."""

import numpy as np

SAMPLE = np.dtype(
    [
        ('table_x', '<f8'),
        ('table_y', '<f8'),
        ('tool_z', '<f8'),
        ('wire_cmd', '<f8'),
        ('voltage_set', '<f8'),
        ('outputs', '<u4'),
        ('pad', '<u4'),
    ]
)  # m, machine coordinates; m/s; V; bits
