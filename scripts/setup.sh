#!/usr/bin/env bash
# Makes the working tree ready: virtual environment, pinned wheels, colcon workspace. Idempotent; the second run takes
# about a second. Without an option it installs and builds what running needs.
# --test:  also what tests, checks and benchmarks need (requirements-test.txt, the firmware's test programs).
# --robot: also what benchmarks and some tests of robots need (requirements-robot.txt).
# --train: also what `waam train` and its tests need (requirements-train.txt: torch, about 5 GB).
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
unset PYTHONDONTWRITEBYTECODE  # as in env.sh
say() { printf '\033[1m[setup]\033[0m %s\n' "$*" >&2; }
die() { printf '\033[31m[setup] %s\033[0m\n' "$*" >&2; exit 1; }

test=no train=no robot=no
for option in "$@"; do
    case $option in
        --test) test=yes ;;
        --train) train=yes ;;
        --robot) robot=yes ;;
        *) die "unknown option '$option'; known are --test, --train and --robot" ;;
    esac
done

started=${EPOCHREALTIME/[.,]/}
seconds() { echo $((($(now) - ${1:-$started} + 500000) / 1000000)); }   # since $1, rounded
now() { echo "${EPOCHREALTIME/[.,]/}"; }

usable_python() {  # $1: a python; true when it is >= 3.11, makes virtual environments, builds extensions and is in none
    "$1" - >/dev/null 2>&1 <<'P'
import ensurepip, pathlib, sys, sysconfig, venv
assert (3, 11) <= sys.version_info < (3, 13)
assert sys.prefix == sys.base_prefix   # . ./env.sh puts .venv first on the path, and .venv may be made anew here
assert (pathlib.Path(sysconfig.get_paths()['include']) / 'Python.h').exists()
P
}
find_python() {  # the first that is usable, wherever it lies on the path: . ./env.sh puts .venv before the others
    local p
    while read -r p; do
        if usable_python "$p"; then echo "$p"; return 0; fi
    done < <(command -v "${PYTHON:-python3}" || true; type -aP python3 python3.12 python3.11 || true; echo /usr/bin/python3)
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

install() { .venv/bin/python scripts/install_wheels.py "$@"; }

wheels=(requirements.txt requirements-open3d.txt scripts/fix_wheels.py)
want=$({ "$python" -c 'import sys; print(sys.version, sys.base_prefix)'; pwd; cat "${wheels[@]}"; } | sha256sum | cut -d' ' -f1)
if [ "$(cat .venv/.waam_ready 2>/dev/null || true)" != "$want" ]; then
    say "virtual environment and wheels ..."
    t=$(now)
    rm -rf .venv   # what the former requirements brought must not stay beside the new
    "$python" -m venv .venv
    install -r requirements.txt && install --no-deps -r requirements-open3d.txt \
        || die "the wheels of requirements.txt could not be installed: is the package index reachable?"
    .venv/bin/python scripts/fix_wheels.py
    echo "$want" > .venv/.waam_ready
    say "wheels $(seconds "$t") s"
fi
if [ $test = yes ] && ! cmp -s requirements-test.txt .venv/.waam_test; then
    t=$(now)
    install -r requirements.txt -r requirements-test.txt || die "the wheels of requirements-test.txt could not be installed"
    # a stock 3-D printing sender that judges our link; its graphical dependencies are left out
    install --no-deps printrun==2.2.0 \
        || say "printrun could not be installed: the tests with a stock sender will be skipped"
    cp requirements-test.txt .venv/.waam_test
    say "wheels of the tests $(seconds "$t") s"
fi
if [ $robot = yes ] && ! cmp -s requirements-robot.txt .venv/.waam_robot; then
    t=$(now)
    if install -r requirements.txt -r requirements-robot.txt; then
        cp requirements-robot.txt .venv/.waam_robot
        say "wheels of robots $(seconds "$t") s"
    else
        say "requirements-robot.txt could not be installed: benchmarks of robots have no baseline, some tests will be skipped"
    fi
fi
if [ $train = yes ] && ! cmp -s requirements-train.txt .venv/.waam_train; then
    say "torch, for waam train and its tests (5 GB) ..."
    t=$(now)
    if install -r requirements.txt -r requirements-train.txt; then
        cp requirements-train.txt .venv/.waam_train
        say "torch $(seconds "$t") s"
    else
        say "torch could not be installed: waam train will not work and its tests will be skipped"
    fi
fi

sources() {  # everything that a build depends on; Python files are linked, so only their names count
    find waam_ws/src waam_ws/vendor -type d -name __pycache__ -prune -o -type f -print | grep -v '\.egg-info/' | LC_ALL=C sort
    find waam_ws/src waam_ws/vendor -type f \( -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name 'CMakeLists.txt' -o -name '*.cmake' \
        -o -name 'package.xml' -o -name 'setup.py' -o -name 'setup.cfg' -o -name '*.c' -o -name '*.h' \) -print0 | LC_ALL=C sort -z | xargs -0 cat
}
warm_up() {  # $*: sim, scan, adapt. Compiles their numerical kernels, which needs nothing of the workspace but the sources.
    local t; t=$(now)
    PYTHONPATH=$(printf '%s:' "$root"/waam_ws/src/*) \
        .venv/bin/python scripts/warm_up.py "$@" > "$root/.setup.$1.log" 2>&1 9>&- \
        || { cat "$root/.setup.$1.log" >&2; return 1; }
    say "kernels of $* $(seconds "$t") s, beside the build"
}
build() {
    local t testing=OFF; t=$(now)
    [ ! -e .venv/.waam_test ] || testing=ON
    export AMENT_PREFIX_PATH=$root/.venv CMAKE_PREFIX_PATH=$root/.venv PATH=$root/.venv/bin:$PATH PYTHONWARNINGS=ignore
    # without it, colcon lets make wait whenever the machine is busy
    export MAKEFLAGS=${MAKEFLAGS:--j$(nproc)}
    unset PYTHONPATH COLCON_PREFIX_PATH
    # CMake refuses a build folder of a package that has moved
    local cache from
    for cache in waam_ws/build/*/CMakeCache.txt; do
        [ -e "$cache" ] || continue
        from=$(sed -n 's|^CMAKE_HOME_DIRECTORY:INTERNAL=||p' "$cache")
        [ -d "$from" ] || rm -rf "$(dirname "$cache")"
    done
    # vendor: packages that no wheel brings; colcon alone passes it by, for a full ROS installation has them
    (cd waam_ws && colcon --log-level error build --base-paths src vendor/* --symlink-install --continue-on-error --parallel-workers 2 \
        --cmake-args -DCMAKE_BUILD_TYPE=RelWithDebInfo "-DPython3_EXECUTABLE=$root/.venv/bin/python3" -Wno-dev \
        -DBUILD_TESTING=$testing -DWAAM_MSGS_FOR_PYTHON=ON > "$root/.setup.log" 2>&1) \
        || { bash scripts/write_env.sh; tail -60 "$root/.setup.log" >&2; die "colcon build failed; the whole log is .setup.log"; }
    bash scripts/write_env.sh
    say "build $(seconds "$t") s"
}
want=$({ cat .venv/.waam_ready scripts/setup.sh; [ ! -e .venv/.waam_test ] || echo with tests; sources; } | sha256sum | cut -d' ' -f1)
if [ "$(cat waam_ws/install/.waam_ready 2>/dev/null || true)" != "$want" ]; then
    say "colcon build and numerical kernels ..."
    warm_up sim & sim=$!
    warm_up scan adapt & scan=$!
    trap 'kill $sim $scan 2>/dev/null || true' EXIT
    build
    wait $sim && wait $scan || die "scripts/warm_up.py failed"
    trap - EXIT
    echo "$want" > waam_ws/install/.waam_ready
    say "all of it $(seconds) s"
fi
say "ready. '. ./env.sh' puts 'waam' on the path; './waam --help' explains it."
