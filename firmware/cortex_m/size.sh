#!/bin/sh
# usage: size.sh COMPILER ELF FLASH RAM
# Prints how much the program uses of its FLASH and RAM in KiB. The linker script enforces these limits.
"$(echo "$1" | sed 's/gcc$/size/')" -A -d "$2" | awk -v elf="$2" -v flash_max=$(($3 * 1024)) -v ram_max=$(($4 * 1024)) '
    $1 == ".boot2" { flash += 256 }
    $1 == ".text" || $1 == ".in_ram" || $1 == ".ARM.exidx" || $1 == ".data" { flash += $2 }
    $1 == ".stack" || $1 == ".data" || $1 == ".bss" || $1 == ".noinit" { ram += $2 }
    $1 == ".stack" { stack = $2 }
    END {
        printf "%s: flash %d of %d bytes, RAM %d of %d bytes (%d of them stack)\n", elf, flash, flash_max, ram, ram_max, stack
        exit !(flash > 0 && flash <= flash_max && ram <= ram_max)
    }'
