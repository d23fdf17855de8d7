"""Rules of the house, checked on the files: pure cores, parameter files, executables, documentation."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
SRC = ROOT / 'waam_ws' / 'src'
PACKAGES = sorted(p.name for p in SRC.iterdir() if (p / 'package.xml').exists())
MODULES = [f for p in PACKAGES for f in (SRC / p / p).glob('**/*.py')]
ROS = {
    'rclpy',
    'waam_msgs',
    'std_msgs',
    'sensor_msgs',
    'geometry_msgs',
    'diagnostic_msgs',
    'rosgraph_msgs',
}
# what may know ROS: nodes, conversions, and the packages whose whole purpose it is
MAY_USE_ROS = re.compile(r'(_node|node_\w+|conversions|ros_\w+|cli)\.py$')
ROS_PACKAGES = {'waam_node', 'waam_bringup'}


def imports(file: Path, top_level_only: bool = False) -> set[str]:
    tree = ast.parse(file.read_text())
    nodes = tree.body if top_level_only else ast.walk(tree)
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {a.name.split('.')[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module.split('.')[0])
    return found


@pytest.mark.parametrize('package', ['waam_process', 'waam_plan'])
def test_pure_packages_know_no_ros(package):
    for file in (SRC / package / package).glob('**/*.py'):
        assert not imports(file) & (ROS | {'waam_node'}), file


def test_pure_cores_do_not_import_rclpy():
    offenders = [
        str(f.relative_to(SRC))
        for f in MODULES
        if f.parts[-2] not in ROS_PACKAGES
        and not MAY_USE_ROS.search(f.name)
        and 'rclpy' in imports(f)
    ]
    assert not offenders


def test_simulator_and_controller_share_no_physics():
    for file in (SRC / 'waam_sim' / 'waam_sim').glob('**/*.py'):
        text = file.read_text()
        used = set(re.findall(r'waam_process\.(\w+)', text)) | set(
            re.findall(r'from waam_process import (\w+)', text)
        )
        assert used <= {'grid', 'segment', 'units'}, file
        assert not imports(file) & {'waam_plan', 'waam_adapt', 'waam_job'}, file


MAY_IMPORT = {  # what people look at stands outside the loop: it may not reach into the packages that run it
    'waam_view': {'waam_process', 'waam_msgs', 'waam_node'},
    'waam_panel': {'waam_process', 'waam_msgs', 'waam_node', 'waam_plan', 'waam_view'},
}


@pytest.mark.parametrize('package,allowed', MAY_IMPORT.items(), ids=MAY_IMPORT)
def test_viewers_import_only_what_they_show(package, allowed):
    for file in (SRC / package / package).glob('**/*.py'):
        used = {name for name in imports(file) if name.startswith('waam_')}
        assert used <= allowed | {package}, file


@pytest.mark.parametrize('package', PACKAGES)
def test_package_is_complete(package):
    folder = SRC / package
    text = (folder / 'package.xml').read_text()
    assert '<license>Apache-2.0</license>' in text
    assert len((folder / 'README.md').read_text()) > 300
    if package != 'waam_msgs':
        assert list((folder / 'test').glob('test_*.py')), f'{package} has no tests'


def test_every_message_says_its_units_or_meaning():
    for file in (SRC / 'waam_msgs').glob('*/*.*'):
        if file.suffix in ('.msg', '.srv', '.action'):
            assert '#' in file.read_text(), file


def test_graph_nodes_have_parameter_files_with_their_own_name():
    graph = yaml.safe_load((SRC / 'waam_bringup' / 'config' / 'graph.yaml').read_text())
    for name, node in graph.items():
        if not node.get('ros', True):
            continue
        file = SRC / node['package'] / 'config' / f'{name}.yaml'
        assert set(yaml.safe_load(file.read_text())) == {name}, file


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
