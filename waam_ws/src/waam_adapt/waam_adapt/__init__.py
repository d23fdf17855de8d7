"""Correction of the next layer from the scan of the last."""

from .api import correct

__all__ = ['correct']
