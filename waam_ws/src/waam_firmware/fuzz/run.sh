#!/usr/bin/env bash
# Fuzzes the parser and the whole controller under libFuzzer with the address and undefined-behaviour sanitizers.
#   fuzz/run.sh [runs of each (default 10000000)] [folder for builds and new inputs (default /tmp/waam_fuzz)]
# A finding stops it and leaves the input in that folder: replay it with  fuzz_core FILE.
# --minimise: afterwards write the smallest inputs with the same coverage into fuzz/corpus.
set -euo pipefail
minimise=; [ "${1:-}" = --minimise ] && { minimise=1; shift; }
package=$(cd "$(dirname "$0")/.." && pwd)
runs=${1:-10000000} work=${2:-/tmp/waam_fuzz}
clang=$(command -v clang || command -v clang-14) || { echo "clang is needed: apt-get install clang" >&2; exit 1; }
cmake -S "$package" -B "$work/build" -DCMAKE_C_COMPILER="$clang" -DWAAM_FUZZ=ON -DBUILD_TESTING=OFF > /dev/null
cmake --build "$work/build" --target fuzz_gcode fuzz_link fuzz_core > /dev/null
for harness in gcode link core; do
    mkdir -p "$work/$harness"
    nice -n 15 "$work/build/fuzz_$harness" -runs="$runs" -max_len=1200 -dict="$package/fuzz/gcode.dict" \
        -print_final_stats=1 -artifact_prefix="$work/" "$work/$harness" "$package/fuzz/corpus/$harness" 2> "$work/$harness.log" \
        || { tail -40 "$work/$harness.log" >&2; exit 1; }
    grep -E 'number_of_executed_units|^#[0-9]+.DONE' "$work/$harness.log"
    if [ -n "$minimise" ]; then
        mkdir -p "$work/minimal"
        "$work/build/fuzz_$harness" -merge=1 "$work/minimal" "$work/$harness" "$package/fuzz/corpus/$harness" 2> /dev/null
        rm -f "$package/fuzz/corpus/$harness"/* && mv "$work/minimal"/* "$package/fuzz/corpus/$harness/"
    fi
done
