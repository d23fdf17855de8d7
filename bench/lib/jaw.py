"""The demo's part as a job of the laboratory."""

from __future__ import annotations

from waam_lab import LabJob

from .preset import preset


def jaw_job(**options) -> LabJob:
    """The worn jaw, restored to 0.2 mm. options: as of waam_lab.restore; preset: that of this run."""
    from waam_bringup.paths import share
    from waam_lab import restore

    parts = share('waam_bringup') / 'parts'
    options = {'preset': preset(), **options}
    return restore(parts / 'jaw_nominal.stl', parts / 'jaw_worn.stl', **options)
