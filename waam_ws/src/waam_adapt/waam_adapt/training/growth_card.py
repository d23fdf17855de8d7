"""The card of a growth network as text for people."""

from __future__ import annotations

from typing import Any


def card_text(card: dict[str, Any], code: str) -> str:
    """The model card as Markdown."""
    m, t, d = card['metrics'], card['training'], card['data']
    return '\n'.join([
        f'# {card["name"]}', '',
        f'{card["purpose"].capitalize()}; {card["parameters"]} parameters; sha256 `{code}`.', '',
        f'Data: {d["layers"]} layers of {d["jobs"]} jobs of the laboratory, seeds {d["seeds"][0]} to {d["seeds"][1]} '
        '(random parts, cells and strategies; `python3 -m waam_lab.growth_data`).',
        'Every eighth job is for validation.', '',
        f'Training: {t["steps"]} steps of {t["batch"]} layers, seed {t["seed"]}.', '',
        f'Jobs of the validation: {m["explained"]:.0%} of the variance of the smoothed growth beside the model is',
        f'predicted ({m["explained_raw"]:.0%} of the raw one). The rest is {m["sigma_ratio"]:.2f} times its sigma.',
        '', *_level_text(m), '', *_residual_text(card.get('residual', [])), '',
        'Plans with a figure outside of these ranges are answered without the network:', '',
        '| figure of the plan | from | to |', '|---|---|---|',
        *(f'| {k} | {a:.3g} | {b:.3g} |' for k, (a, b) in card['seen'].items()), '',
    ])  # fmt: skip


def _level_text(metrics: dict[str, float]) -> list[str]:
    """Of the card, on the level of a layer."""
    if 'level_std' not in metrics:
        return ['Level of a layer: not told; the jobs were too few.']
    std, left = metrics['level_std'], metrics['level_left']
    return [
        f'Level of a layer about the mean of its job: {std:.1%} RMS, {left:.1%} beside what the figures of its plan',
        'tell (jobs left out of the fit).',
    ]


def _residual_text(rounds: list[dict[str, Any]]) -> list[str]:
    """Of the card, on the regression of what the loop leaves; rounds: what each one was worth."""
    if not rounds:
        return ['What the loop leaves: not told.']
    return [
        'What the loop leaves, told by a regression, in rounds:',
        *(
            f'{r["layers"]} layers of {r["jobs"]} jobs, seeds {r["seeds"][0]} to {r["seeds"][1]}, {r["explained"]:.0%}'
            ' of the variance of jobs left out.'
            for r in rounds
        ),
    ]
