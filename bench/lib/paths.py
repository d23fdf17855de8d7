"""Where things lie that benchmarks read."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / 'waam_ws' / 'src'
DATA = ROOT.parent / 'shared' / 'data'  # recordings; they lie beside the checkout or nowhere
