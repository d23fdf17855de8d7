"""The metal models by name: `metal` (portions), `metal_sections`, `metal_film`.

All keep the height field and the records of `metal.Metal`. Each has a compiled `advance` (`pool.make_advance`), which
lives through one sample; `step` calls the one that is asked for. A new model is named here and called there. Of the
state others read `active`, `surface`, `head_x`, `head_y`, `pool_x`, `pool_y`, `width`, `portion`,
`portion_x`, `portion_y`, `deposited` and `lost`.
"""

from __future__ import annotations

PORTIONS, SECTIONS, FILM = 0, 1, 2
MODELS = {'portions': PORTIONS, 'sections': SECTIONS, 'film': FILM}


def number(model: str) -> int:
    """Of a model, as `step.live` takes it; ValueError that names the known ones."""
    if model not in MODELS:
        raise ValueError(f"metal_model is '{model}', known are {', '.join(MODELS)}")
    return MODELS[model]
