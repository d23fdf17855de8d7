"""All cases of the readers."""

from reader_clouds import CASES as CLOUDS
from reader_meshes import CASES as MESHES
from reader_packages import CASES as PACKAGES
from reader_programs import CASES as PROGRAMS

CASES = [*CLOUDS, *MESHES, *PACKAGES, *PROGRAMS]
