"""The card of a network as text for people."""

from __future__ import annotations

from typing import Any


def card_text(card: dict[str, Any], code: str) -> str:
    """The model card as Markdown."""
    m, t, d = card['metrics'], card['training'], card['data']
    return '\n'.join([
        f'# {card["name"]}', '',
        f'{card["purpose"].capitalize()}; {card["parameters"]} parameters; sha256 `{code}`.', '',
        f'Data: {d["layers"]} layers of {d["jobs"]} jobs of the laboratory, seeds {d["seeds"][0]} to {d["seeds"][1]},',
        f'metal models {", ".join(d["families"])} (random parts, cells, presets and strategies; `python3 -m',
        'waam_lab.training_data`). Every eighth job is for validation.', '',
        f'Training: {t["steps"]} steps of {t["batch"]} layers, seed {t["seed"]}.', '',
        f'Jobs of the validation: {m["explained"]:.0%} of the variance of the shape that the base law leaves is told,',
        f'{m["explained_level"]:.0%} of that of the levels. The rest is {m["sigma_ratio"]:.2f} times its sigma.', '',
        f'Weight in a job that has laid nothing yet: {m["weight_shape"]:.2f} of the shape, {m["weight_level"]:.2f} of',
        'the level, as earned in the worst family.', '',
        'Plans with a figure outside of these ranges are answered without the network:', '',
        '| figure of the plan | from | to |', '|---|---|---|',
        *(f'| {k} | {a:.3g} | {b:.3g} |' for k, (a, b) in card['seen'].items()), '',
    ])  # fmt: skip
