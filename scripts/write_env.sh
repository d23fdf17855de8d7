#!/usr/bin/env bash
# Writes waam_ws/install/env.sh: the result of sourcing the workspace, as plain exports (sourcing all packages takes a second, this does not).
set -eo pipefail
cd "$(dirname "$0")/.."
root=$PWD
names='AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH'
for n in $names; do unset "$n"; done
export AMENT_PREFIX_PATH=$root/.venv CMAKE_PREFIX_PATH=$root/.venv
. waam_ws/install/setup.bash >/dev/null
{
    for n in $names; do
        [ -n "${!n:-}" ] && printf 'export %s=%q\n' "$n" "${!n}"
    done
    true
} > waam_ws/install/env.sh
