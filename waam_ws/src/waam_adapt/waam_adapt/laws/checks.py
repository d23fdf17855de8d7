"""Reasons not to trust a height map or a law: stale, mostly unseen, implausible, not finite. Any reason removes the
correction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Correction, CorrectionInput, CorrectionLaw, nothing


@dataclass(frozen=True)
class MapLimits:
    """max_age s; min_coverage share of the footprint; max_sigma and max_error m (medians over the
    footprint).
    """

    max_age: float = 300.0
    min_coverage: float = 0.5
    max_sigma: float = 0.3e-3
    max_error: float = 5e-3


@dataclass(frozen=True)
class MapOrigin:
    """Where a map comes from."""

    age: float  # s since its last profile
    job_id: str  # that the map names
    expected_job_id: str  # that the request names
    layers: int  # deposited before the scan
    expected_layers: int  # that the plan expects below
    plausible: bool  # word of the node that made the map
    reasons: tuple[str, ...] = ()  # why it is not plausible


def reasons_against(
    origin: MapOrigin, request: CorrectionInput, limits: MapLimits
) -> tuple[str, ...]:
    """All reasons, in words with figures; empty when the map may be used."""
    return (*_stale(origin, limits), *_implausible(origin), *_unusable(request, limits))


def _stale(origin: MapOrigin, limits: MapLimits) -> list[str]:
    reasons = []
    if not -1.0 <= origin.age <= limits.max_age:
        reasons.append(f'stale map: {origin.age:.1f} s old, limit {limits.max_age:.0f} s')
    if origin.job_id != origin.expected_job_id:
        reasons.append(f"stale map: of job '{origin.job_id}', not '{origin.expected_job_id}'")
    if origin.layers != origin.expected_layers:
        reasons.append(
            f'stale map: taken after layer {origin.layers}, not {origin.expected_layers}'
        )
    return reasons


def _implausible(origin: MapOrigin) -> list[str]:
    if origin.plausible:
        return []
    return [f'implausible map: {r}' for r in origin.reasons] or [
        'implausible map: the scan says so'
    ]


def _unusable(request: CorrectionInput, limits: MapLimits) -> list[str]:
    footprint = request.footprint & np.isfinite(request.target)
    if not footprint.any():
        return ['nothing planned: the footprint of the layer is empty']
    error = request.error[footprint]
    seen = np.isfinite(error)
    reasons = []
    if seen.mean() < limits.min_coverage:
        share, limit = seen.mean(), limits.min_coverage
        reasons.append(f'partial map: {share:.0%} of the footprint seen, limit {limit:.0%}')
    if seen.any():
        level = abs(float(np.median(error[seen])))
        reasons += _above('implausible map: median error', level, limits.max_error)
    if request.sigma is not None and np.isfinite(request.sigma[footprint]).any():
        sigma = float(np.nanmedian(request.sigma[footprint]))
        reasons += _above('uncertain map: median sigma', sigma, limits.max_sigma)
    return reasons


def _above(what: str, value: float, limit: float) -> list[str]:
    if value <= limit:
        return []
    return [f'{what} {value * 1e3:.2f} mm, limit {limit * 1e3:.2f} mm']


def safe_correct(
    law: CorrectionLaw, request: CorrectionInput, reasons: tuple[str, ...]
) -> Correction:
    """The law's correction, or none at all (fallback) when there are reasons against the input or
    the output is not usable.
    """
    shape, k_gain = request.z.shape, request.k_gain
    if reasons:
        return nothing(shape, k_gain, law.name, reasons)
    result = law.correct(request)
    maps = (result.psi, result.confidence, result.residual_height)
    if any(m.shape != shape or not np.isfinite(m).all() for m in maps):
        return nothing(shape, k_gain, law.name, (f'law {law.name} gave a map that is not finite',))
    if np.abs(result.psi).max() > 1.0:
        return nothing(shape, k_gain, law.name, (f'law {law.name} gave |psi| above 1',))
    return result
