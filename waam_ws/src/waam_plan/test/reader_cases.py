"""All cases of the readers."""

from reader_arrays import ARRAYS, UNITS
from reader_marks import MARKS
from reader_meshes import CASES as MESHES
from reader_package_cases import CASES as PACKAGES
from reader_programs import CASES as PROGRAMS
from reader_texts import TEXTS

CASES = [*MARKS, *TEXTS, *ARRAYS, *UNITS, *MESHES, *PACKAGES, *PROGRAMS]
