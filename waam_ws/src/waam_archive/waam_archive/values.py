"""Values of files that anybody may have written: what is no number, text or truth becomes None."""

from __future__ import annotations

import math
from datetime import UTC, date, datetime
from typing import Any

MAX_INTEGER = 2**63 - 1


def number(value: Any) -> float | None:
    """A finite float, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) else None


def integer(value: Any) -> int | None:
    """An int of 64 bits, or None."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > MAX_INTEGER:
        return None
    return value


def truth(value: Any) -> bool | None:
    """True, False or None."""
    return value if isinstance(value, bool) else None


def text(value: Any) -> str | None:
    """A text that UTF-8 can hold; None for anything else and for an empty one."""
    if not isinstance(value, str) or not value:
        return None
    return value.encode('utf-8', 'replace').decode('utf-8')


def numbers(value: Any) -> list[float] | None:
    """A list of finite numbers, or None."""
    if not isinstance(value, list | tuple):
        return None
    found = [number(v) for v in value]
    return None if None in found else [v for v in found if v is not None]


def moment(value: Any) -> datetime | None:
    """ISO 8601 as UTC without a zone (TIMESTAMP); None for what is none."""
    try:
        found = datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return None
    try:
        return found.astimezone(UTC).replace(tzinfo=None) if found.tzinfo else found
    except OverflowError:
        return None


def mapping(value: Any) -> dict:
    """A dict, else an empty one."""
    return value if isinstance(value, dict) else {}


def dicts(value: Any) -> list[dict]:
    """The dicts of a list."""
    return [v for v in value if isinstance(v, dict)] if isinstance(value, list) else []


def ratio(above: float | None, below: float | None) -> float | None:
    """None when one is unknown or there is nothing to divide by."""
    return above / below if above is not None and below else None


def plain(value: Any) -> Any:
    """For JSON: numbers that it has not become null, times ISO 8601, arrays lists."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, datetime | date):
        return value.isoformat()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return plain(value.tolist()) if hasattr(value, 'tolist') else str(value)
