"""Repairs two paths of the machine that built the ROS wheels, which they carry in their CMake exports."""

import pathlib
import re
import sys
import sysconfig

import numpy

NUMPY = re.compile(r'/opt/python/cp\d+-cp\d+/lib/python3\.\d+/site-packages/numpy/[\w/]*?include')
PYTHON = re.compile(r'/opt/python/cp\d+-cp\d+/include/python3\.\d+')


def main() -> None:
    """Rewrites every CMake file below <venv>/share that names the build machine."""
    for file in pathlib.Path(sys.prefix, 'share').rglob('*.cmake'):
        text = file.read_text(encoding='utf-8', errors='surrogateescape')
        fixed = NUMPY.sub(numpy.get_include(), text)
        fixed = PYTHON.sub(sysconfig.get_paths()['include'], fixed)
        if fixed != text:
            file.unlink()  # it may be a hard link into the installer's cache, which stays as it is
            file.write_text(fixed, encoding='utf-8', errors='surrogateescape')


if __name__ == '__main__':
    main()
