#!/bin/sh
# usage: size.sh COMPILER ELF
# Prints how much the program uses of its 20 KiB of flash and 4 KiB of RAM. The linker script enforces these limits.
"$(echo "$1" | sed 's/gcc$/size/')" -A -d "$2" | awk -v elf="$2" '
    $1 == ".text" || $1 == ".ARM.exidx" || $1 == ".data" { flash += $2 }
    $1 == ".stack" || $1 == ".data" || $1 == ".bss" || $1 == ".noinit" { ram += $2 }
    $1 == ".stack" { stack = $2 }
    END {
        printf "%s: flash %d of 20480 bytes, RAM %d of 4096 bytes (%d of them stack)\n", elf, flash, ram, stack
        exit !(flash > 0 && flash <= 20480 && ram <= 4096)
    }'
