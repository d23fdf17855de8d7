"""The layout of the plant sample stands once in Python, and it is that of the controller core in C.

The cell of the firmware's tests reads it a second time, on purpose: it is written from
waam_firmware/doc/plant_port.md alone.
"""

import re
from pathlib import Path

from waam_process.plant_port import SAMPLE

SOURCE = Path(__file__).parents[1] / 'waam_ws' / 'src'
FOREIGN = SOURCE / 'waam_firmware' / 'test' / 'plant_cell.py'
HEADER = SOURCE / 'waam_firmware' / 'host' / 'host_harness.h'
SIZES = {'double': 8, 'uint32_t': 4}


def _c_layout() -> list[tuple[str, int]]:
    """(name, bytes) of the fields of host_sample_t."""
    text = re.sub(r'/\*.*?\*/', '', HEADER.read_text(), flags=re.DOTALL)
    body = re.search(r'struct[^{}]*\{([^{}]*)\}\s*host_sample_t;', text)
    assert body, 'host_sample_t is not where it was'
    found = []
    for kind, names in re.findall(r'(\w+) ([\w, ]+);', body[1]):
        found += [(name.strip(), SIZES[kind]) for name in names.split(',')]
    return found


def test_the_sample_is_laid_out_as_in_the_controller_core() -> None:
    names = SAMPLE.names
    assert names is not None
    python = [(name.replace('pad', 'padding'), SAMPLE[name].itemsize) for name in names]
    assert python == _c_layout()
    assert SAMPLE.itemsize == sum(size for _, size in python) == 48


def test_no_other_module_lays_it_out_again() -> None:
    copies = [
        str(path.relative_to(SOURCE))
        for path in SOURCE.rglob('*.py')
        if re.search(r"""['"]table_x['"],\s*['"]<f8['"]""", path.read_text())
    ]
    assert copies == ['waam_process/waam_process/plant_port.py']
    layout = re.compile(r"""['"]<5dI(?:4x|I)['"]""")
    packed = [path for path in SOURCE.rglob('*.py') if layout.search(path.read_text())]
    assert packed == [FOREIGN]
    assert 'plant_port' not in ' '.join(imports(FOREIGN)), 'it is to stay a reading of its own'


def imports(file: Path) -> list[str]:
    """The lines of a file that import."""
    return re.findall(r'^\s*(?:from|import) .*', file.read_text(), re.MULTILINE)
