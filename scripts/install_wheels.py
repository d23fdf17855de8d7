"""Installs wheels into this Python's environment: `install_wheels.py ARGUMENTS of pip install`.

uv does it where it can be had (it downloads side by side, links from its cache and compiles nothing), else pip. The
configuration of pip holds for both: package index, certificates, cache and whatever else the machine has set.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys

UV = 'uv==0.13.9'
PIP = [sys.executable, '-m', 'pip']

# What pip calls an option -> uv's variable for it.
SINGLE = {
    'index-url': 'UV_DEFAULT_INDEX',
    'cert': 'SSL_CERT_FILE',
    'timeout': 'UV_HTTP_TIMEOUT',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'no-index': 'UV_NO_INDEX',
    'no-cache-dir': 'UV_NO_CACHE',
    'proxy': 'ALL_PROXY',
}
LISTS = {
    'extra-index-url': ('UV_EXTRA_INDEX_URL', ' '),
    'find-links': ('UV_FIND_LINKS', ','),
    'trusted-host': ('UV_INSECURE_HOST', ' '),
    'constraint': ('UV_CONSTRAINT', ' '),
}
WITHOUT_EFFECT = {
    'config-file',  # what it says is listed too
    'disable-pip-version-check',
    'no-input',
    'progress-bar',
    'quiet',
    'verbose',
    'root-user-action',
    'retries',
    'require-virtualenv',
    'break-system-packages',
    'no-python-version-warning',
    'prefer-binary',
    'no-compile',
    'no-warn-script-location',
    'no-color',
}


def pip_options() -> dict[str, str]:
    """The options that pip's files and variables set for `pip install`, the stronger source last."""
    listed = subprocess.run([*PIP, 'config', 'list'], capture_output=True, text=True, check=True)
    found: dict[str, dict[str, str]] = {'global': {}, 'install': {}, ':env:': {}}
    for line in listed.stdout.splitlines():
        name, _, value = line.partition('=')
        section, _, option = name.rpartition('.')
        if section in found:
            found[section][option] = str(ast.literal_eval(value))
    return found['global'] | found['install'] | found[':env:']


def uv_environment(options: dict[str, str]) -> dict[str, str] | None:
    """pip's options as variables of uv; None when one has no counterpart, so that pip has to do it."""
    variables = {
        'UV_INDEX_STRATEGY': 'unsafe-best-match'
    }  # as pip: the best version of all indexes
    for option, value in options.items():
        if option in SINGLE:
            variables[SINGLE[option]] = value
        elif option in LISTS:
            variable, separator = LISTS[option]
            variables[variable] = separator.join(value.split())
        elif option == 'cache-dir':
            variables['UV_CACHE_DIR'] = os.path.join(value, 'uv')
        elif option not in WITHOUT_EFFECT:
            return None
    return variables


def with_uv(arguments: list[str]) -> bool:
    """True when uv was there, could be used and has installed everything."""
    variables = uv_environment(pip_options())
    if variables is None:
        return False
    quiet = ['-q', '--disable-pip-version-check', '--no-compile']
    got = subprocess.run([*PIP, 'install', *quiet, '--no-deps', UV], capture_output=True)
    if got.returncode:
        return False
    command = [sys.executable, '-m', 'uv', 'pip', 'install', '-q', '--python', sys.executable]
    # the variables of uv that the user has set count more than what pip's configuration says
    return subprocess.run([*command, *arguments], env=variables | os.environ).returncode == 0


def main(arguments: list[str]) -> int:
    if with_uv(arguments):
        return 0
    print('[setup] installing with pip, which takes longer than uv', file=sys.stderr)
    command = [*PIP, 'install', '-q', '--disable-pip-version-check', '--no-compile']
    return subprocess.run([*command, *arguments]).returncode


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
