"""Rules of the house, checked on the files: pure cores, parameter files, executables, documentation."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest
import yaml
from cores import TALKS_TO_THE_WORLD, violations
from importlinter.cli import lint_imports
from purity import impurities, longest_call, modules

ROOT = Path(__file__).parents[1]
SRC = ROOT / 'waam_ws' / 'src'
PACKAGES = sorted(p.name for p in SRC.iterdir() if (p / 'package.xml').exists())
PYTHON = [p for p in PACKAGES if (SRC / p / p / '__init__.py').exists()]
MODULES = modules(SRC)
ROS = re.compile(r'(rclpy|\w+_msgs|\w+_srvs|\w+_interfaces|ament_index_python|rosidl_\w+)(\.|$)')


@pytest.fixture(scope='module')
def imports():
    """The graph of all imports, also those in functions and for type checking."""
    return grimp.build_graph(*PYTHON, include_external_packages=True, cache_dir=None)


def test_packages_import_lower_layers_only_and_nothing_goes_round_in_a_circle():
    config = ROOT / '.importlinter'
    listed = re.search(r'root_packages =\n((?: +\w+\n)+)', config.read_text())
    assert listed and listed[1].split() == PYTHON
    assert lint_imports(config_filename=str(config), no_cache=True) == 0


def test_cores_know_no_ros_no_clock_and_no_disk(imports):
    ros = {name for name in imports.modules if ROS.match(name)}
    know_ros = ros.union(*(imports.find_downstream_modules(name) for name in ros))
    assert 'waam_job.ros.ros_cell' in know_ros and 'waam_job.run.layer_cycle' not in know_ros
    found = violations(MODULES, know_ros)
    assert not found, '\n'.join(f'{file}: {what} in a core' for file, what in sorted(found))


@pytest.mark.parametrize('pattern', TALKS_TO_THE_WORLD)
def test_files_that_talk_to_the_world_do_so(pattern):
    files = [m for m in MODULES if re.fullmatch(pattern, m.file)]
    assert any(impurities(m) for m in files), 'strike it from the table'


def test_no_call_has_more_positional_arguments_than_a_reader_can_count():
    """What needs more says which is which by keywords. Tests, benchmarks and compiled loops as well."""
    trees = {f'{SRC.relative_to(ROOT)}/{m.file}': m.tree for m in MODULES}
    for folder in (*SRC.glob('*/test'), ROOT / 'bench', ROOT / 'test', ROOT / 'scripts'):
        for file in folder.glob('**/*.py'):
            trees[str(file.relative_to(ROOT))] = ast.parse(file.read_text())
    count, where = longest_call(trees)
    assert count <= 8, f'{where}: {count} positional arguments'


def test_simulator_and_controller_share_no_physics(imports):
    own = [m.name for m in MODULES if m.package == 'waam_sim']
    used = set().union(*(imports.find_modules_directly_imported_by(name) for name in own))
    shared = {name.removeprefix('waam_process.') for name in used if 'waam_process' in name}
    # plant_port: the layout of the bytes between both, no formula
    assert shared and shared <= {'grid', 'plant_port', 'segment', 'units'}


@pytest.mark.parametrize('package', PACKAGES)
def test_package_is_complete(package):
    folder = SRC / package
    text = (folder / 'package.xml').read_text()
    assert '<license>Apache-2.0</license>' in text
    assert len((folder / 'README.md').read_text()) > 300
    if not package.endswith('_msgs'):
        assert list((folder / 'test').glob('test_*.py')), f'{package} has no tests'
    if (folder / 'setup.py').exists():
        assert (
            "extras_require={'test': ['pytest']}" in (folder / 'setup.py').read_text()
        )  # colcon test


def test_no_test_imports_a_module_whose_name_is_not_its_own():
    """All tests run in one process: `import conftest` and a helper's name that two folders use give either file."""
    files = [*SRC.glob('*/test/*.py'), *(ROOT / 'test').glob('*.py')]
    helpers = [f.stem for f in files if not f.stem.startswith(('test_', 'conftest'))]
    assert sorted(helpers) == sorted(set(helpers))
    wrong = [f for f in files if re.search(r'^\s*(from|import) conftest', f.read_text(), re.M)]
    assert not wrong, 'use a fixture'


def without_comment(text: str) -> list[str]:
    """Fields of a message, service or action that say nothing about themselves. Constants may speak for themselves."""
    lines = [line.strip() for line in text.splitlines()]
    fields = [line for line in lines if line and line[0] != '#' and line != '---']
    return [f for f in fields if '#' not in f and '=' not in f]


def test_every_field_of_a_message_says_its_unit_or_meaning():
    assert without_comment('# Head.\nuint8 OK=0\nuint8 code\n---\nint8 n # m\n') == ['uint8 code']
    for file in (SRC / 'waam_msgs').glob('*/*.*'):
        if file.suffix in ('.msg', '.srv', '.action'):
            assert not without_comment(file.read_text()), file


def test_graph_nodes_have_parameter_files_with_their_own_name():
    graph = yaml.safe_load((SRC / 'waam_bringup' / 'config' / 'graph.yaml').read_text())
    for name, node in graph.items():
        if not node.get('ros', True):
            continue
        name = node.get('name', name)
        file = SRC / node['package'] / 'config' / f'{name}.yaml'
        assert set(yaml.safe_load(file.read_text())) == {f'/**/{name}'}, file


def test_repository_holds_no_machine_paths_or_registry_hosts():
    words = re.compile(r'/work/(main|shared)|/root/|pypi\.org|files\.pythonhosted')
    listed = subprocess.run(
        ['git', '-C', ROOT, 'ls-files'], capture_output=True, text=True, check=True
    )
    for file in (ROOT / name for name in listed.stdout.splitlines()):
        if not file.is_file():
            continue
        if file.suffix in ('.py', '.md', '.sh', '.yaml', '.c', '.h', '.txt', '.xml', '.toml', ''):
            if file.name == Path(__file__).name or file.name.startswith('.setup'):
                continue
            found = words.search(file.read_text(errors='ignore'))
            assert not found, f'{file}: {found.group(0)}'


# ---- dependencies ----------------------------------------------------------------------------

# rosdep's keys of modules whose name differs from theirs
ROSDEP = {
    'aiohttp': 'python3-aiohttp', 'lz4': 'python3-lz4', 'matplotlib': 'python3-matplotlib', 'numba': 'python3-numba',
    'numpy': 'python3-numpy', 'open3d': 'python3-open3d', 'pymodbus': 'python3-pymodbus', 'rich': 'python3-rich',
    'scipy': 'python3-scipy', 'serial': 'python3-serial', 'shapely': 'python3-shapely',
    'trimesh': 'python3-trimesh-pip', 'yaml': 'python3-yaml', 'zstandard': 'python3-zstandard',
}  # fmt: skip
# without a key: `pip install -r requirements.txt` (and -robot, -train), as docs/ros.md says
PIP_ONLY = {
    'apprise', 'coal', 'contourpy', 'duckdb', 'kiss_icp', 'mcap', 'pinocchio', 'pyarrow', 'rerun',
    'rerun_bindings', 'rerun_cli', 'rosbags', 'shtab', 'toppra', 'torch',
}  # fmt: skip


def imported(tree: ast.AST) -> set[str]:
    """First names of the modules that a file imports."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {a.name.split('.')[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names.add(node.module.split('.')[0])
    return names


@pytest.mark.parametrize('package', PACKAGES)
def test_every_import_is_a_declared_dependency(package):
    declared = set(
        re.findall(r'<(?:exec_|build_)?depend>([^<]+)', (SRC / package / 'package.xml').read_text())
    )
    used = set().union(*(imported(m.tree) for m in MODULES if m.package == package), set())
    used -= set(sys.stdlib_module_names) | PIP_ONLY | {package}
    assert not {ROSDEP.get(name, name) for name in used} - declared


@pytest.mark.parametrize(
    'line', [v for v in (ROOT / 'test' / 'long_tests.txt').read_text().splitlines() if v[:1] != '#']
)
def test_what_is_left_out_of_make_test_exists_and_has_a_reason(line):
    named, reason = line.split(' | ')
    file, *function = named.split('::')
    assert (ROOT / file).exists() and reason
    for name in function:
        assert f'def {name.split("[")[0]}(' in (ROOT / file).read_text()
