#!/usr/bin/env bash
# All tests: every package's own, then those of the whole graph.
# They drive real processes over real DDS on whatever machine this is: one that fails is run once more; the summary names it (RERUN).
# Arguments go to pytest instead of the default selection, without reruns.
set -euo pipefail
cd "$(dirname "$0")/.."
export ROS_PYTHON_CHECK_FIELDS=1 OMP_NUM_THREADS=1
if [ $# -gt 0 ]; then exec python3 -m pytest "$@"; fi
again=(--reruns 1 -r R)
# two processes, a file in one of them; the files that take longest come first, so that none is left alone at the end
both=(-n 2 --dist loadfile --no-loadscope-reorder --durations=15 "${again[@]}")
code=0
python3 -m pytest "${both[@]}" waam_ws/src/waam_{view,lab}/test waam_ws/src/*/test || code=$?
python3 -m pytest "${both[@]}" test/test_{kill,resume_graph,job_graph}.py test || code=$?
exit $code
