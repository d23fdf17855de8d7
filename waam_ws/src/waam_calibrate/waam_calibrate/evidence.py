"""The one error of all calibrations. Pure."""

from __future__ import annotations


class EvidenceError(ValueError):
    """The measurement does not tell what it should; the text says why and what to do."""
