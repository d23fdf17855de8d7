"""Compiles the numba kernels once, so that the first start of a graph does not wait for it."""

import waam_scan.fusion.height_map
import waam_sim.plant


def main() -> None:
    waam_sim.plant.warm_up()
    waam_scan.fusion.height_map.warm_up()


if __name__ == '__main__':
    main()
