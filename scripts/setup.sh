#!/usr/bin/env bash
# Makes the working tree ready: virtual environment, pinned wheels, colcon workspace. Idempotent; the second run takes about a second.
# --train: also what `waam train` and its tests need (torch, about 5 GB).
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
say() { printf '\033[1m[setup]\033[0m %s\n' "$*" >&2; }
die() { printf '\033[31m[setup] %s\033[0m\n' "$*" >&2; exit 1; }

usable_python() {  # $1: a python; true when it is >= 3.11 and can make virtual environments and build extensions
    "$1" - <<'P' >/dev/null 2>&1
import ensurepip, pathlib, sys, sysconfig, venv
assert (3, 11) <= sys.version_info < (3, 13)
assert (pathlib.Path(sysconfig.get_paths()['include']) / 'Python.h').exists()
P
}
find_python() {
    local p
    for p in ${PYTHON:+"$PYTHON"} python3 python3.12 python3.11 /usr/bin/python3; do
        if command -v "$p" >/dev/null 2>&1 && usable_python "$p"; then command -v "$p"; return 0; fi
    done
    return 1
}

need=()
command -v cc >/dev/null && command -v c++ >/dev/null || need+=(build-essential)
command -v cmake >/dev/null || need+=(cmake)
command -v flock >/dev/null || need+=(util-linux)
find_python >/dev/null || need+=(python3 python3-venv python3-dev)
# what open3d is linked with and does not bring along
PATH=$PATH:/sbin:/usr/sbin ldconfig -p | grep -q 'libusb-1\.0\.so\.0' || need+=(libusb-1.0-0)
if [ ${#need[@]} -gt 0 ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        say "installing from the distribution: ${need[*]}"
        apt-get update -qq && apt-get install -y -qq --no-install-recommends "${need[@]}" >/dev/null
    else
        die "missing: ${need[*]}. Ask an administrator to run:  apt-get install ${need[*]}   (then call this again)"
    fi
fi
python=$(find_python) || die "no Python 3.11 or 3.12 with venv and headers was found (set PYTHON=/path/to/python3.11 to choose one)"

exec 9>"$root/.setup.lock"
flock 9

want=$({ "$python" -c 'import sys; print(sys.version, sys.base_prefix)'; pwd; cat requirements.txt scripts/fix_wheels.py; } | sha256sum | cut -d' ' -f1)
if [ "$(cat .venv/.waam_ready 2>/dev/null || true)" != "$want" ]; then
    say "virtual environment and wheels (about a minute) ..."
    [ "$(cat .venv/.waam_python 2>/dev/null || true)" = "$("$python" -c 'import sys; print(sys.version)') $root" ] || rm -rf .venv
    [ -d .venv ] || "$python" -m venv .venv
    "$python" -c 'import sys; print(sys.version, end=" ")' > .venv/.waam_python; echo "$root" >> .venv/.waam_python
    .venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt \
        || die "pip could not install requirements.txt: is the package index reachable?"
    # a stock 3-D printing sender that judges our link; its graphical dependencies are left out
    .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps printrun==2.2.0 \
        || say "printrun could not be installed: the tests with a stock sender will be skipped"
    .venv/bin/python scripts/fix_wheels.py
    echo "$want" > .venv/.waam_ready
    rm -f .venv/.waam_train
fi
if [ "${1:-}" = --train ] && ! cmp -s requirements-train.txt .venv/.waam_train; then
    say "torch, for waam train and its tests (one or two minutes, 5 GB) ..."
    if .venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt -r requirements-train.txt; then
        cp requirements-train.txt .venv/.waam_train
    else
        say "torch could not be installed: waam train will not work and its tests will be skipped"
    fi
fi

sources() {  # everything that a build depends on; Python files are linked, so only their names count
    find waam_ws/src -type d -name __pycache__ -prune -o -type f -print | grep -v '\.egg-info/' | LC_ALL=C sort
    find waam_ws/src -type f \( -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name 'CMakeLists.txt' -o -name 'package.xml' \
        -o -name 'setup.py' -o -name 'setup.cfg' -o -name '*.c' -o -name '*.h' \) -print0 | LC_ALL=C sort -z | xargs -0 cat
}
want=$({ cat .venv/.waam_ready scripts/setup.sh; sources; } | sha256sum | cut -d' ' -f1)
if [ "$(cat waam_ws/install/.waam_ready 2>/dev/null || true)" != "$want" ]; then
    say "colcon build (first time about a minute) ..."
    export AMENT_PREFIX_PATH=$root/.venv CMAKE_PREFIX_PATH=$root/.venv PATH=$root/.venv/bin:$PATH PYTHONWARNINGS=ignore
    unset PYTHONPATH COLCON_PREFIX_PATH
    (cd waam_ws && colcon --log-level error build --symlink-install --continue-on-error --parallel-workers 2 \
        --cmake-args -DCMAKE_BUILD_TYPE=RelWithDebInfo "-DPython3_EXECUTABLE=$root/.venv/bin/python3" -Wno-dev > "$root/.setup.log" 2>&1) \
        || { bash scripts/write_env.sh; tail -60 "$root/.setup.log" >&2; die "colcon build failed; the whole log is .setup.log"; }
    bash scripts/write_env.sh
    say "compiling numerical kernels (half a minute) ..."
    bash -c '. ./env.sh && python3 scripts/warm_up.py' >> "$root/.setup.log" 2>&1 \
        || { tail -20 "$root/.setup.log" >&2; die "scripts/warm_up.py failed; the whole log is .setup.log"; }
    echo "$want" > waam_ws/install/.waam_ready
fi
say "ready. '. ./env.sh' puts 'waam' on the path; './waam --help' explains it."
