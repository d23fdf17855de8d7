"""Helpers of these tests are importable by name (--import-mode=importlib); no deadlines on busy machines."""

import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))
settings.register_profile('waam', deadline=None)
settings.load_profile('waam')
