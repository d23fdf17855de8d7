"""What a job has cost, by a file of prices. The file is optional; what it does not price is not counted and said."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from waam_node import job_folder
from waam_process.safe_files import FileError, is_file, read_mapping

LONGEST = 8  # characters of a currency
HOW = (
    f'No prices are known. A file {job_folder.PRICES} in the folder of the jobs gives them: currency, wire_per_kg, '
    'gas_per_l, energy_per_kwh, machine_per_h, new_part (any of them may be left out).'
)


@dataclass(frozen=True)
class Prices:
    """Money per unit; None = not given."""

    currency: str
    wire_per_kg: float | None = None
    gas_per_l: float | None = None
    energy_per_kwh: float | None = None
    machine_per_h: float | None = None
    new_part: float | None = None


class PriceError(ValueError):
    """A file of prices that is not understood; the text names file and field."""


@dataclass(frozen=True)
class Use:
    """What a job has used; NaN = not known."""

    wire_kg: float
    gas_l: float
    energy_kwh: float
    machine_h: float


def find_prices(folder: Path) -> Prices | None:
    """Of the job, of the folder that it lies in, or, for a run of a demo, of the one above that: the first one.

    PriceError for a file that cannot be understood.
    """
    folder = Path(folder).absolute()
    places = [folder, folder.parent]
    if is_file(folder.parent / job_folder.REPORT):
        places.append(folder.parent.parent)
    for place in places:
        if is_file(place / job_folder.PRICES):
            return read_prices(place / job_folder.PRICES)
    return None


def read_prices(file: Path) -> Prices:
    """PriceError for a field that is unknown or not a number of 0 or more, and without a currency."""
    try:
        given = read_mapping(file)
    except FileError as e:
        raise PriceError(str(e)) from None
    names = set(Prices.__dataclass_fields__)
    if unknown := sorted(str(k) for k in given if k not in names):
        raise PriceError(
            f'{file.name}: unknown: {", ".join(unknown)}; known: {", ".join(sorted(names))}'
        )
    currency = given.pop('currency', None)
    if not isinstance(currency, str) or not 0 < len(currency) <= LONGEST:
        raise PriceError(
            f'{file.name}: currency must be a word of at most {LONGEST} characters, such as EUR'
        )
    for name, value in given.items():
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not 0 <= value < math.inf
        ):
            raise PriceError(f'{file.name}: {name} must be a number of 0 or more, not {value!r}')
    return Prices(currency, **{k: float(v) for k, v in given.items()})


def costs(prices: Prices, use: Use) -> tuple[list[tuple[str, float]], list[str]]:
    """((what, money) of each that has a price and an amount, names of those that have not)."""
    pairs = [
        ('wire', prices.wire_per_kg, use.wire_kg),
        ('shielding gas', prices.gas_per_l, use.gas_l),
        ('energy of the arc', prices.energy_per_kwh, use.energy_kwh),
        ('machine', prices.machine_per_h, use.machine_h),
    ]
    known = [(what, p * n) for what, p, n in pairs if p is not None and math.isfinite(n)]
    return known, [what for what, p, n in pairs if p is None or not math.isfinite(n)]
