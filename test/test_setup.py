"""scripts/install_wheels.py and scripts/fix_wheels.py: the machine's configuration of pip, the installer's cache."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPTS = Path(__file__).resolve().parents[1] / 'scripts'


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def wheels() -> ModuleType:
    return script('install_wheels')


def test_uv_asks_the_index_that_pip_is_configured_for(wheels, tmp_path, monkeypatch):
    for name in [n for n in os.environ if n.startswith('PIP_')]:
        monkeypatch.delenv(name)
    config = tmp_path / 'pip.conf'
    config.write_text(
        '[global]\nindex-url = https://a.invalid/simple\ntimeout = 7\n'
        '[install]\nindex-url = https://b.invalid/simple\nfind-links =\n  /one\n  /two\n'
    )
    monkeypatch.setenv('PIP_CONFIG_FILE', str(config))
    monkeypatch.setenv('PIP_CACHE_DIR', '/cache')
    monkeypatch.setenv('PIP_TIMEOUT', '9')
    variables = wheels.uv_environment(wheels.pip_options())
    assert variables['UV_DEFAULT_INDEX'] == 'https://b.invalid/simple'
    assert variables['UV_FIND_LINKS'] == '/one,/two'
    assert variables['UV_HTTP_TIMEOUT'] == '9'
    assert variables['UV_CACHE_DIR'] == '/cache/uv'


def test_an_option_of_pip_that_uv_has_not_is_left_to_pip(wheels):
    assert wheels.uv_environment({'client-cert': '/key'}) is None


def test_pip_installs_when_uv_cannot_be_had(wheels, monkeypatch, capfd):
    """`no-index` keeps uv away; pip then answers that the package is not there."""
    monkeypatch.setenv('PIP_NO_INDEX', '1')
    monkeypatch.delenv('PIP_FIND_LINKS', raising=False)
    monkeypatch.setattr(wheels, 'UV', 'uv==0.0.0.dev0')
    monkeypatch.setenv('PIP_DRY_RUN', '1')
    assert wheels.main(['no-such-package-of-waam']) != 0
    err = capfd.readouterr().err
    assert 'installing with pip' in err and 'no-such-package-of-waam' in err


def test_repaired_exports_leave_the_installers_cache_alone(tmp_path):
    """Wheels are hard links into the cache of uv, which other environments are made from."""
    cached = tmp_path / 'cached.cmake'
    text = 'set(x /opt/python/cp311-cp311/include/python3.11)'
    cached.write_text(text)
    (tmp_path / 'share').mkdir()
    os.link(cached, tmp_path / 'share/linked.cmake')
    code = f'import sys; sys.prefix = {str(tmp_path)!r}; import fix_wheels; fix_wheels.main()'
    subprocess.run([sys.executable, '-c', code], cwd=SCRIPTS, check=True)
    assert '/opt/python/' not in (tmp_path / 'share/linked.cmake').read_text()
    assert cached.read_text() == text


@pytest.mark.parametrize('wanted', ['', '/no/such/python'])
def test_a_python_of_a_virtual_environment_is_not_taken_for_a_new_one(wanted):
    """`. ./env.sh` puts that of .venv first on the path, and `make setup` may have to make .venv anew."""
    text = (SCRIPTS / 'setup.sh').read_text()
    functions = text[text.index('usable_python() {') : text.index('need=()')]
    here = Path(sys.executable).parent
    inside = f'PATH={here}:$PATH; PYTHON={wanted}; command -v python3; find_python'
    out = subprocess.run(
        ['bash', '-c', f'set -euo pipefail\n{functions}\n{inside}'],
        capture_output=True,
        text=True,
        check=True,
    )
    first, found = out.stdout.split()
    assert Path(first).parent == here != Path(found).parent


def test_programs_of_the_workspace_keep_their_bytecode():
    """Where the machine forbids it, every node would compile all that it imports at every start."""
    shown = subprocess.run(
        ['bash', '-c', '. ./env.sh && python3 -c "import sys; print(sys.dont_write_bytecode)"'],
        cwd=SCRIPTS.parent,
        env=os.environ | {'PYTHONDONTWRITEBYTECODE': '1'},
        capture_output=True,
        text=True,
        check=True,
    )
    assert shown.stdout.strip() == 'False'


def test_waam_may_be_called_from_a_python_program():
    """The wheels of ROS start every Python anew with their libraries on the path, once: env.sh sets that path anew."""
    code = 'import rclpy.impl.implementation_singleton'
    ran = subprocess.run(
        ['bash', '-c', f'. ./env.sh && python3 -c "{code}"'],
        cwd=SCRIPTS.parent, capture_output=True, text=True,
        env=os.environ | {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '1'},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr[-500:]
