#!/bin/sh
# Prints line and branch coverage of the named sources. Fails below 95 % of lines or 85 % of branches.
# usage: coverage.sh OBJECT_DIRECTORY SOURCE…
directory=$1
shift
for source in "$@"; do
    gcov --branch-counts --branch-probabilities --stdout \
        --object-directory "$directory/test-core-$(basename "$source" .c).gcda" "$source" 2>/dev/null
done | awk -F: '
    # Only lines of core/*.c count; gcov prints a source once for every object that includes it.
    $3 ~ /^Source$/ || $2 ~ /^ *0$/ && $3 == "Source" { wanted = ($4 ~ /^core\/.*\.c$/); file = $4; next }
    !wanted { next }
    /^branch / { branches++; if ($0 !~ /never executed|taken 0( |$)/) taken++; next }
    $1 ~ /^ *#####/ { lines++; print file ":" $2 + 0 " not reached:" $3 }
    $1 ~ /^ *[0-9]+\*?$/ { lines++; reached++ }
    END {
        if (!lines) { print "coverage: no data"; exit 1 }
        printf "coverage of firmware/core: %.1f %% of %d lines, %.1f %% of %d branches\n",
            100 * reached / lines, lines, 100 * taken / branches, branches
        exit !(reached / lines >= 0.95 && taken / branches >= 0.85)
    }'
