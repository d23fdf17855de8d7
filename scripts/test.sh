#!/usr/bin/env bash
# All tests: every package's own (in two processes, for most of them wait), then those of the whole graph, one after the other.
# They drive real processes over real DDS on whatever machine this is: one that fails is run once more; the summary names it (RERUN).
# Arguments go to pytest instead of the default selection, without reruns.
set -euo pipefail
cd "$(dirname "$0")/.."
export ROS_PYTHON_CHECK_FIELDS=1 OMP_NUM_THREADS=1
if [ $# -gt 0 ]; then exec python3 -m pytest "$@"; fi
again=(--reruns 1 -r R)
code=0
python3 -m pytest -n 2 --dist loadfile --durations=15 "${again[@]}" waam_ws/src/*/test || code=$?
python3 -m pytest --durations=15 "${again[@]}" test || code=$?
exit $code
