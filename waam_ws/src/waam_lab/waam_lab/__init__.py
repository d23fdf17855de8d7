"""The laboratory: whole jobs on the simulated cell in one process, without ROS, many times faster than real time."""

from .job import Fault, LabJob, LabMaps, LabResult, build, restore
from .laboratory import over_seeds, run
from .many import run_many

__all__ = [
    'Fault',
    'LabJob',
    'LabMaps',
    'LabResult',
    'build',
    'over_seeds',
    'restore',
    'run',
    'run_many',
]
