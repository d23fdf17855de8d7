"""Loops of the controller as libraries of their own (test/arc_loop.c, test/standoff_loop.c)."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path


def path(loop: str) -> Path:
    """File of a loop, say 'arc_loop': beside the virtual controller that WAAM_VIRTUAL_CONTROLLER names, else in the
    workspace's install folder. There is none in a build with sanitizers."""
    name = f'libwaam_{loop}.so'
    if controller := os.environ.get('WAAM_VIRTUAL_CONTROLLER'):
        return Path(controller).with_name(name)
    return Path(__file__).parents[3] / 'install/waam_firmware/lib' / name


def load(loop: str) -> ctypes.CDLL:
    """The library of a loop; OSError where there is none."""
    return ctypes.CDLL(str(path(loop)))
