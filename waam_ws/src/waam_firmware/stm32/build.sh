#!/usr/bin/env bash
# Builds the firmware of the STM32F407 and prints what it needs of flash and RAM.
#   stm32/build.sh [--usb] [folder (default: ~/.cache/waam_stm32)]
# Images: waam_stm32f407 (link on USART2, for ST-Link adapters), waam_qemu (the same for QEMU's netduinoplus2),
# waam_qemu_wrap (that with counters about to wrap, for a test) and, with --usb, waam_stm32f407_usb (link over the USB
# connector; needs cargo and, once: rustup target add thumbv7em-none-eabihf).
# Needs: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi cmake
set -euo pipefail
usb=OFF; [ "${1:-}" = --usb ] && { usb=ON; shift; }
here=$(cd "$(dirname "$0")" && pwd)
build=${1:-${XDG_CACHE_HOME:-$HOME/.cache}/waam_stm32}
command -v arm-none-eabi-gcc > /dev/null || { echo "gcc-arm-none-eabi is missing: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi" >&2; exit 1; }
log=$build/build.log
mkdir -p "$build"
exec 9> "$build/.lock"
flock 9 # two tests may build at once
{ cmake -S "$here" -B "$build" -DCMAKE_TOOLCHAIN_FILE="$here/toolchain.cmake" -DWAAM_USB=$usb && cmake --build "$build" -j2; } \
    > "$log" 2>&1 || { tail -40 "$log" >&2; exit 1; }
printf '%-24s %8s of %7s %8s of %6s\n' image flash 1048576 RAM 131072
for image in "$build"/*.elf; do
    [ "$usb" = OFF ] && [ "$(basename "$image")" = waam_stm32f407_usb.elf ] && continue
    [ "$(basename "$image")" = waam_qemu_wrap.elf ] && continue # waam_qemu with other numbers to begin with
    arm-none-eabi-size -A "$image" | awk -v name="$(basename "$image" .elf)" '
        $1 == ".vectors" || $1 == ".text" || $1 == ".ARM.exidx" { flash += $2 }
        $1 == ".data" { flash += $2; ram += $2 }
        $1 == ".bss" || $1 == ".noinit" || $1 == ".guard" || $1 == ".stack" { ram += $2 }
        END { printf "%-24s %8d (%4.1f %%) %8d (%4.1f %%)\n", name, flash, flash / 10485.76, ram, ram / 1310.72 }'
done
