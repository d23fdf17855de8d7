"""The laboratory: whole jobs on the simulated cell in one process, without ROS, many times faster than real time."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .job import Fault, LabJob, LabMaps, LabResult, build, restore, restore_shaft
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
    'restore_shaft',
    'run',
    'run_many',
]
_MODULE_OF = {
    **dict.fromkeys(
        ('Fault', 'LabJob', 'LabMaps', 'LabResult', 'build', 'restore', 'restore_shaft'), 'job'
    ),
    **dict.fromkeys(('over_seeds', 'run'), 'laboratory'),
    'run_many': 'many',
}


def __getattr__(name: str) -> Any:
    """Imports the laboratory when one of its names is asked for, so that `waam --help` starts without it."""
    if name not in _MODULE_OF:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULE_OF[name]}'), name)
