#!/usr/bin/env bash
# Fuzzes the parser, the link, the settings and the whole controller under libFuzzer with the address and undefined-behaviour sanitizers.
#   test/fuzz/run.sh [--minimise] [executions of each (default 10000000)] [folder (default /tmp/waam_fuzz)] [gcode|link|settings|core ...]
# It goes on where an earlier call with the same folder and the same sources was stopped: executions.txt in that folder holds
# what was done, in portions. A finding stops it and leaves the input in the folder: replay it with  build/fuzz_core FILE.
# --minimise: afterwards write the smallest inputs with the same coverage into test/fuzz/corpus.
set -euo pipefail
[ "${1:-}" = --help ] && { sed -n '2,6s/^# //p' "$0"; exit 0; }
minimise=; [ "${1:-}" = --minimise ] && { minimise=1; shift; }
package=$(cd "$(dirname "$0")/../.." && pwd)
runs=${1:-10000000} work=${2:-/tmp/waam_fuzz}
shift $(($# < 2 ? $# : 2))
[ $# -gt 0 ] || set -- gcode link settings core
portion=200000
[ -n "${AMENT_PREFIX_PATH:-}" ] || { set +u; . "$package/../../../env.sh"; set -u; } # cmake looks for ament
clang=$(command -v clang || command -v clang-14) || { echo "clang is needed: apt-get install clang" >&2; exit 1; }
cmake -S "$package" -B "$work/build" -DCMAKE_C_COMPILER="$clang" -DWAAM_FUZZ=ON -DBUILD_TESTING=OFF > /dev/null
cmake --build "$work/build" --target fuzz_gcode fuzz_link fuzz_settings fuzz_core > /dev/null

sources() { # what a harness exercises
    cd "$package"
    case $1 in
    gcode) cat test/fuzz/fuzz_gcode.c core/gcode/*.[ch] core/common/*.[ch] ;;
    link) cat test/fuzz/fuzz_link.c core/link/*.[ch] core/common/*.[ch] ;;
    settings) cat test/fuzz/fuzz_settings.c host/adxl345_device.[ch] core/*/*.[ch] ;;
    core) cat test/fuzz/fuzz_core.c host/adxl345_device.[ch] core/*/*.[ch] ;;
    esac | sha256sum | cut -c1-12
}

executed() { # of this harness with these sources
    awk -v h="$1" -v s="$2" '$1 == h && $2 == s { n += $3 } END { print n + 0 }' "$work/executions.txt" 2> /dev/null || echo 0
}

for harness in "$@"; do
    mkdir -p "$work/$harness"
    state=$(sources "$harness")
    while count=$(executed "$harness" "$state"); [ "$count" -lt "$runs" ]; do
        left=$((runs - count)) longest=1200
        [ "$harness" = gcode ] && longest=400 # some lines; a line has at most 160 bytes
        nice -n 15 "$work/build/fuzz_$harness" -runs=$((left < portion ? left : portion)) -max_total_time=120 -max_len=$longest \
            -dict="$package/test/fuzz/gcode.dict" -print_final_stats=1 -artifact_prefix="$work/" \
            "$work/$harness" "$package/test/fuzz/corpus/$harness" 2> "$work/$harness.log" || { tail -40 "$work/$harness.log" >&2; exit 1; }
        done_now=$(awk '/number_of_executed_units/ { print $2 }' "$work/$harness.log")
        echo "$harness $state $done_now $(date -u +%FT%TZ)" >> "$work/executions.txt"
    done
    echo "$harness: $count executions of sources $state, no finding"
    if [ -n "$minimise" ]; then
        rm -rf "$work/minimal" && mkdir -p "$work/minimal"
        "$work/build/fuzz_$harness" -merge=1 "$work/minimal" "$work/$harness" "$package/test/fuzz/corpus/$harness" 2> /dev/null
        rm -f "$package/test/fuzz/corpus/$harness"/* && mv "$work/minimal"/* "$package/test/fuzz/corpus/$harness/"
    fi
done
