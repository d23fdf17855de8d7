#!/usr/bin/env bash
# The C code under the compilers' warnings, gcc's analyser and cppcheck, for the host and for the board:
#   lint.sh                      everything
#   lint.sh --warnings           only the warnings, some seconds
#   lint.sh [--warnings] FILE... only these files, as code of the host
# Ends with 1 where something was found, or where a tool is not installed, whose name it says.
set -euo pipefail
cd "$(dirname "$0")"
deep=yes; [ "${1:-}" = --warnings ] && { deep=; shift; }
flags=(-std=c11 -O2 -Wall -Wextra -Werror -Wshadow -Wstrict-prototypes -Wconversion -Wsign-conversion -c -o /dev/null)
include=(-Ihost -Istm32 -Itest/fuzz); for room in core/*/; do include+=("-I$room"); done
host=("$@"); board=()
if [ $# = 0 ]; then
  host=(core/*/*.c host/*.c test/*.c test/fuzz/*.c stm32/port_usb.c)
  board=(core/*/*.c stm32/*.c test/target/*.c)
fi
processor=(-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard -ffreestanding)
failed=0

have() { # program, package, what is left unchecked without it
  command -v "$1" > /dev/null || { echo "lint: $1 is not installed (apt-get install $2): $3 unchecked" >&2; failed=1; return 1; }
}
compile() { # compiler, further flags, --, files
  local compiler=$1 more=(); shift
  while [ "$1" != -- ]; do more+=("$1"); shift; done; shift
  for file; do "$compiler" "${flags[@]}" "${more[@]}" "${include[@]}" "$file" || failed=1; done
}
analyser=(); [ -z "$deep" ] || analyser=(-fanalyzer)
if have gcc gcc "warnings of the host's code"; then
  compile gcc -D_GNU_SOURCE "${analyser[@]}" -- "${host[@]}"
fi
if [ ${#board[@]} -gt 0 ] && have arm-none-eabi-gcc gcc-arm-none-eabi "the board's code"; then
  compile arm-none-eabi-gcc "${processor[@]}" -Wframe-larger-than=2000 "${analyser[@]}" -- "${board[@]}"
fi
if [ -n "$deep" ] && have cppcheck cppcheck "what cppcheck finds"; then
  cppcheck --quiet --std=c11 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
    "${include[@]}" "${host[@]}" "${board[@]}" || failed=1
fi
exit $failed
