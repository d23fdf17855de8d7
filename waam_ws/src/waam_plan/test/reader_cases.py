"""All cases of the readers."""

from reader_clouds import CASES as CLOUDS

CASES = [*CLOUDS]
