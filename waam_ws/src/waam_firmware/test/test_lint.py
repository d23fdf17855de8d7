"""The C code under the compilers' strict warnings; the analysers, which take longer, are a part of `make lint`."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

LINT = Path(__file__).parents[1] / 'lint.sh'


def lint(*arguments: str, path: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {'PATH': path} if path else None
    return subprocess.run(
        [str(LINT), *arguments], capture_output=True, text=True, env=environment, timeout=600
    )


def test_all_code_compiles_without_a_warning():
    for tool in ('gcc', 'arm-none-eabi-gcc'):
        if not shutil.which(tool):
            pytest.skip(f'not installed: {tool}')
    done = lint('--warnings')
    assert (done.returncode, done.stderr) == (0, '')


@pytest.mark.parametrize(
    ('code', 'told'),
    [
        ('short f(int a);\nshort f(int a) { return a; }\n', 'Werror=conversion'),
        ('unsigned f(int a);\nunsigned f(int a) { return 2u + a; }\n', 'Werror=sign-conversion'),
    ],
)
def test_conversions_that_lose_something_are_refused(tmp_path, code, told):
    if not shutil.which('gcc'):
        pytest.skip('not installed: gcc')
    (tmp_path / 'bad.c').write_text(code)
    done = lint('--warnings', str(tmp_path / 'bad.c'))
    assert done.returncode == 1 and told in done.stderr
    (tmp_path / 'good.c').write_text('int f(int a);\nint f(int a) { return a; }\n')
    assert lint('--warnings', str(tmp_path / 'good.c')).returncode == 0


def test_a_tool_that_is_not_there_is_said_by_name(tmp_path):
    for tool in ('bash', 'dirname'):
        (tmp_path / tool).symlink_to(shutil.which(tool))
    done = lint(path=str(tmp_path))
    assert done.returncode == 1
    for tool in ('gcc', 'arm-none-eabi-gcc', 'cppcheck'):
        assert f'lint: {tool} is not installed' in done.stderr
