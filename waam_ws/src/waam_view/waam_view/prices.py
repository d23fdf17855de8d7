"""What a job has cost, by a file of prices. The file is optional; what it does not price is not counted and said."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from waam_node import job_folder
from waam_process.prices import PriceError, Prices
from waam_process.safe_files import FileError, is_file, read_mapping

LONGEST = 8  # characters of a currency
HOW = (
    f'No prices are known. A file {job_folder.PRICES} in the folder of the jobs gives them: currency, wire_per_kg, '
    'gas_per_hour, energy_per_kWh, machine_per_hour, labour_per_hour, new_part (any may be left out).'
)


@dataclass(frozen=True)
class Use:
    """What a job has used; NaN = not known."""

    wire_kg: float
    gas_l: float
    arc_h: float
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
        found = Prices.parse(given)
    except (FileError, PriceError) as e:
        raise PriceError(f'{file.name}: {e}') from None
    currency = given.get('currency')
    if not isinstance(currency, str) or not 0 < len(currency) <= LONGEST:
        raise PriceError(
            f'{file.name}: currency must be a word of at most {LONGEST} characters, such as EUR'
        )
    return found


def costs(prices: Prices, use: Use, material: str) -> tuple[list[tuple[str, float]], list[str]]:
    """((what, money) of each that has a price and an amount, names of those that have not)."""
    pairs = [
        ('wire', prices.wire(material), use.wire_kg),
        ('shielding gas', prices.gas_per_hour, use.arc_h),
        ('energy of the arc', prices.energy_per_kWh, use.energy_kwh),
        ('machine', prices.machine_per_hour, use.machine_h),
        ('labour', prices.labour, use.machine_h),
    ]
    known = [(what, p * n) for what, p, n in pairs if p is not None and math.isfinite(n)]
    return known, [what for what, p, n in pairs if p is None or not math.isfinite(n)]
