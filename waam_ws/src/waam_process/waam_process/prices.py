"""A file of prices (YAML, docs/archive.md): what jobs cost, for the report of one job and the figures of many. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

JOULE_PER_KWH = 3.6e6


class PriceError(ValueError):
    """A price file that cannot be used; the text names the entry."""


@dataclass(frozen=True)
class Prices:
    """Money per unit; None = not given. wire_per_kg: by material; `default` for all others."""

    currency: str = 'EUR'
    wire_per_kg: dict[str, float] = field(default_factory=dict)
    gas_per_hour: float | None = None  # of arc time
    energy_per_kWh: float | None = None  # of arc energy
    machine_per_hour: float | None = None  # of machine time
    labour_per_hour: float | None = None  # of machine time, times labour_share
    labour_share: float = 1.0
    new_part: float | None = None  # what the restored part would cost new

    @classmethod
    def parse(cls, data: Any) -> Prices:
        """PriceError for an entry that is unknown, negative or no number."""
        known = [f.name for f in fields(cls)]
        if not isinstance(data, dict):
            raise PriceError('a price file holds a mapping of names and prices')
        for name in data:
            if name not in known:
                raise PriceError(f"'{name}' is no price; known are {', '.join(known)}")
        prices = {k: _price(k, v) for k, v in data.items() if k not in ('currency', 'wire_per_kg')}
        wire = data.get('wire_per_kg', {})
        wire = wire if isinstance(wire, dict) else {'default': wire}
        by_material = {str(k): _price(f'wire_per_kg.{k}', v) for k, v in wire.items()}
        return cls(str(data.get('currency', cls.currency)), by_material, **prices)

    def wire(self, material: str | None) -> float | None:
        """Per kg; None when the file has no price for it."""
        return self.wire_per_kg.get(material or '', self.wire_per_kg.get('default'))

    @property
    def labour(self) -> float | None:
        """Per hour of machine time."""
        return None if self.labour_per_hour is None else self.labour_per_hour * self.labour_share


def _price(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise PriceError(f'{name} must be a number of 0 or more, not {value!r}')
    return float(value)
