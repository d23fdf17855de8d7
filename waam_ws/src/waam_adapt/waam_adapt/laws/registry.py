"""All correction laws by name. A new law is added here, and nowhere else.

A law is a class with a `name` and `correct(CorrectionInput) -> Correction` (`types.CorrectionLaw`). Write it in a
module of this folder and add a line to `LAWS`: the parameter `law` of correction_server, `waam_adapt.correct` and the
benchmarks take it from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..types import CorrectionError, CorrectionLaw
from .bead_solver_law import BeadSolver
from .explicit import DampedInverse, Zero
from .unet_law import UNetLaw


@dataclass(frozen=True)
class LawSettings:
    """What the laws can be set to; each takes what it knows."""

    gain: float = 0.9  # share of the height error that one layer is to remove
    regularisation: float = 0.1  # of the deconvolution of overlapping beads
    # weights of law unet: a file, '' = the packaged ones, 'none' = its bead model alone
    model: str = ''

    @property
    def inverse(self) -> DampedInverse:
        """The explicit law that the others begin with and fall back on."""
        return DampedInverse(self.gain, self.regularisation)


# Laws that solve for the beads, so that it is worth comparing layers with the bead model.
BEAD_LAWS = ('bead_solver', 'unet')

LAWS: dict[str, Callable[[LawSettings], CorrectionLaw]] = {
    'damped_inverse': lambda s: s.inverse,
    'bead_solver': lambda s: BeadSolver(s.inverse),
    'unet': lambda s: UNetLaw.load(s.model, s.inverse),
    'zero': lambda s: Zero(),
}


# Laws of former versions, and what to write in their place.
GONE = {'growth_net': 'unet', 'proportional': 'damped_inverse', 'log_log': 'damped_inverse'}


def make_law(
    name: str, gain: float = 0.9, regularisation: float = 0.1, model: str = ''
) -> CorrectionLaw:
    """The law of that name with its settings (`LawSettings`); CorrectionError names the known ones."""
    if name in GONE:
        raise CorrectionError(f"law '{name}' is gone: write '{GONE[name]}'")
    if name not in LAWS:
        raise CorrectionError(f"unknown law '{name}'; known are {', '.join(LAWS)}")
    return LAWS[name](LawSettings(gain, regularisation, model))
