"""Compiles the numba kernels once, so that the first start of a graph does not wait for it.

`warm_up.py [sim] [scan] [adapt]`
"""

import sys


def sim() -> None:
    """The simulated cell."""
    import waam_sim.plant

    waam_sim.plant.warm_up()


def scan() -> None:
    """Fusion of scans."""
    import waam_scan.fusion.height_map

    waam_scan.fusion.height_map.warm_up()


def adapt() -> None:
    """Metal along the beads of a layer, and the correction network."""
    import waam_adapt.beads.kernels
    import waam_adapt.laws.convolution

    waam_adapt.beads.kernels.warm_up()
    waam_adapt.laws.convolution.warm_up()


def main(names: list[str]) -> None:
    """Compiles what is named; everything when nothing is."""
    known = {'sim': sim, 'scan': scan, 'adapt': adapt}
    for name in names or known:
        known[name]()


if __name__ == '__main__':
    main(sys.argv[1:])
