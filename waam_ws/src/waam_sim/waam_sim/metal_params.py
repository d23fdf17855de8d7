"""Parameters of the simulated metal: bead, melt, metal balance, scatter."""

from __future__ import annotations

from dataclasses import dataclass

from waam_node.params import param

from .metal_models import MODELS


@dataclass(frozen=True)
class MetalParams:
    """Bead, melt and metal balance. The metal balance is deliberately not the one of the controller's tables."""

    model: str = param(
        'portions',
        'how the melt becomes a bead: portions that share themselves out, sections that overlap, a film that levels',
        choices=tuple(MODELS),
    )
    cell: float = 4e-4  # edge of a cell of the height field [m]
    margin: float = 0.015  # rim of bare table around the part [m]
    wire_diameter: float = param(1.185e-3, 'true diameter of the wire', 'm', 5e-4, 2.5e-3)
    transfer: float = param(
        0.91, 'share of the wire that becomes bead at 15 mm and 150 degrees', '', 0.1, 1.0
    )
    spatter_per_m: float = param(
        7.0, 'loss of transfer per metre of contact distance beyond 15 mm', '1/m', 0.0, 50.0
    )
    hot_loss_per_k: float = 1.5e-4  # loss of transfer per kelvin above 150 degrees [1/K]
    no_gas_loss: float = 0.15  # loss of transfer without shielding gas
    width_ref: float = param(
        7.0e-3, 'width of a single bead at the reference point', 'm', 2e-3, 2e-2
    )
    power_ref: float = 2500.0  # electrical power at the reference point [W]
    speed_ref: float = 0.010  # travel speed at the reference point [m/s]
    power_exponent: float = 0.35  # d ln(width) / d ln(power)
    speed_exponent: float = param(0.65, '-d ln(width) / d ln(travel speed)', '', 0.0, 1.5)
    hot_width_per_k: float = param(
        4e-4, 'gain of width per kelvin above 150 degrees', '1/K', 0.0, 5e-3
    )
    levelling: float = param(
        0.55, 'share of the relief below it that the melt evens out', '', 0.0, 1.0
    )
    hot_levelling_per_k: float = 6e-4  # gain of levelling per kelvin above 150 degrees [1/K]
    overhang_share: float = 0.45  # share of its metal that a cell without support takes
    slump_slope: float = param(4.0, 'steepest slope of fresh melt at 150 degrees', '', 0.6, 20.0)
    hot_slump_per_k: float = 6e-3  # loss of that slope per kelvin above 150 degrees [1/K]
    slump_rate: float = 0.05  # share of a cell that runs down per portion of melt
    pool_lag: float = param(
        0.45, 'distance of the pool behind the arc, in bead widths', '', 0.05, 2.0
    )
    pool_lag_time: float = 1.0  # time in which a pool at rest flows under the arc [s]
    start_narrowing: float = param(
        0.15, 'share of width that is missing at an arc start', '', 0.0, 0.6
    )
    start_length: float = 6e-3  # path on which the width comes up after a start [m]
    crater_depth: float = param(0.35, 'depth of the end crater in bead heights', '', 0.0, 1.0)
    area_noise_fixed: float = param(
        0.03, 'sigma of bead area that returns in every layer', '', 0.0, 0.3
    )
    area_noise_layer: float = param(
        0.045, 'sigma of bead area that changes with height', '', 0.0, 0.3
    )
    width_noise: float = param(0.03, 'sigma of bead width', '', 0.0, 0.3)
    width_follows: float = param(
        0.0, 'd ln(width) / d ln(bead area) of that noise of area', '', 0.0, 1.0
    )
    noise_length: float = param(
        9e-3, 'correlation length of the noise in the plane', 'm', 1e-3, 0.1
    )
    noise_height: float = 2e-3  # correlation length of the noise along z [m]
    portion_path: float = 2e-4  # path between two portions of melt [m]
    portion_time: float = 0.02  # time between two portions of melt at most [s]
    # of model sections alone
    # path on which a section takes what is molten, in bead widths
    sections_pool_length: float = 0.2
    sections_narrowing: float = 0.25  # share of width that is missing at an arc start
    sections_narrow_path: float = 4e-3  # path on which the width comes up after a start [m]
    # by which a section may begin below the ground under it, in bead heights
    sections_sag: float = 0.7
    sections_fillet: float = 1.0  # share of a valley beside another bead that fills to the tangent
    # of model film alone
    film_mobility: float = 6e-6  # D of a film as thick as the bead at 150 degrees [m^2/s]
    film_bump: float = 0.55  # radius of what is poured, in halves of the bead width
    film_trail: float = 0.3  # distance of the pour behind the arc, in bead widths
    film_remelt: float = 2e-4  # depth of ground that melts again [m]
    film_pressure: float = 0.3  # by which the arc presses the film down, in bead heights
    film_hot_start: float = 0.15  # share of width that is missing at an arc start
