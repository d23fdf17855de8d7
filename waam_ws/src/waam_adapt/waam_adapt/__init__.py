"""Correction of the next layer from the scan of the last."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import correct

__all__ = ['correct']


def __getattr__(name: str) -> Any:
    """Imports the laws when `correct` is asked for: a node or a verb that needs none of them starts without SciPy."""
    if name != 'correct':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from .api import correct

    return correct
