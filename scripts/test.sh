#!/usr/bin/env bash
# The type checker and the tests: every package's own, then those of the whole graph. What test/long_tests.txt names is
# left out, unless the first argument is --all.
# They drive real processes over real DDS on whatever machine this is: one that fails is run once more; the summary names it (RERUN).
# Other arguments go to pytest instead of the default selection, without reruns.
set -euo pipefail
cd "$(dirname "$0")/.."
export ROS_PYTHON_CHECK_FIELDS=1 OMP_NUM_THREADS=1
some=(-m 'not long')
if [ "${1:-}" = --all ]; then some=() && shift; fi
if [ $# -gt 0 ]; then exec python3 -m pytest "$@"; fi
export COLUMNS=200  # pytest leaves the reason out of its summary where the line has no room for it
again=(--reruns 1 -r R)
# A file runs in one process; the files that take longest come first, so that none is left alone at the end. The tests of
# the packages wait a third of their time; two graphs are what two cores bear.
files=(--dist loadfile --no-loadscope-reorder --durations=25 "${again[@]}" "${some[@]}")
logs=$(mktemp -d)
checker=
trap '[ -z "$checker" ] || kill $checker 2>/dev/null || true; rm -rf "$logs"' EXIT
failed=()
# beside the first tests: on a fresh machine it computes for a minute
typed=()  # where PyTorch is missing, mypy cannot know the types of the training
python3 -c 'import torch' 2>/dev/null || mapfile -t typed < <(sed -n '/^packages = \[/,/^\]/p' pyproject.toml | grep -o 'waam_[a-z_]*' | grep -v waam_train | sed 's/^/-p\n/')
nice mypy "${typed[@]}" > "$logs/types" 2>&1 & checker=$!
python3 -m pytest -n 3 "${files[@]}" waam_ws/src/waam_{view,lab}/test waam_ws/src/*/test | tee "$logs/packages" || failed+=(packages)
wait $checker || failed+=(types)
checker=
cat "$logs/types"
python3 -m pytest -n 2 "${files[@]}" test/test_{kill,resume_graph,job_graph}.py test | tee "$logs/graph" || failed+=(graph)
# Whoever sees only the end of this output sees here what failed and what was run twice.
for part in packages types graph; do
  grep -E '^(FAILED|ERROR|RERUN) |error:|^=+ .*(passed|failed|error).* =+$' "$logs/$part" | cut -c -300 | sed "s/^/$part: /" || true
done
if [ ${#some[@]} -gt 0 ]; then
  echo "left out, for make test-all (test/long_tests.txt):"
  sed -n 's/.* | /  /p' test/long_tests.txt | sort | uniq -c
fi
[ ${#failed[@]} -eq 0 ] || { echo "failed: ${failed[*]}"; exit 1; }
