"""Units of files, screens and the wire, to and from SI. A name says what it converts."""


def m_min(value: float) -> float:
    """m/min -> m/s"""
    return value / 60.0


def to_m_min(value: float) -> float:
    """m/s -> m/min"""
    return value * 60.0


def to_mm_min(value: float) -> float:
    """m/s -> mm/min"""
    return value * 60e3


def mm(value: float) -> float:
    """mm -> m"""
    return value * 1e-3


def to_mm(value: float) -> float:
    """m -> mm"""
    return value * 1e3
