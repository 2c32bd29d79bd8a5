# Coverage-guided fuzzing of the daemon's C. Included by the Makefile, whose `fuzz` and `fuzz-short` call this.
#   make fuzz-wire fuzz-clock fuzz-tables fuzz-frame   FUZZ_SECONDS each, from the kept corpus on; what is found stays in build/fuzz
#   make fuzz-keep   what of that reaches new code joins tests/corpus, which every test run replays
FUZZ_SECONDS ?= 300
FUZZ_C := wire clock tables frame
FUZZ_FLAGS := -std=c11 -g -O1 -Wall -Wextra -Werror -Wconversion -Wno-sign-conversion \
	-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all
# A dozen lines; a thousand packets; a few numbers, which are used over and over; a hundred frames or more.
FUZZ_MAX_wire := 1024
FUZZ_MAX_clock := 6000
FUZZ_MAX_tables := 256
FUZZ_MAX_frame := 400
FUZZ_ALSO_frame := -len_control=0
FUZZ_SOURCES_wire := sample newest
FUZZ_SOURCES_clock := clock
FUZZ_SOURCES_tables := contact/network contact/refine contact/response arithmetic/descent arithmetic/matrix
# What pyproject.toml compiles into the pad, without what needs Python.
FUZZ_SOURCES_frame := $(shell sed -n '/"fmfts.pipeline._pad"/,/^\]/s|.*"daemon/fmfts/\(.*\)\.c".*|\1|p' pyproject.toml | grep -v /_)
FUZZ_FOLDER_wire := sensor/wire
FUZZ_FOLDER_clock := sensor/wire
FUZZ_FOLDER_tables := .
FUZZ_FOLDER_frame := .

.PHONY: fuzz-peers fuzz-keep $(FUZZ_C:%=fuzz-%) $(FUZZ_C:%=fuzz-keep-%)

$(FUZZ_C:%=fuzz-%): fuzz-%: build/fuzz/fuzz-%
	@mkdir -p build/fuzz/$*
	cd build/fuzz && ./fuzz-$* -seed=1 -max_total_time=$(FUZZ_SECONDS) -max_len=$(FUZZ_MAX_$*) $(FUZZ_ALSO_$*) -print_final_stats=1 $* $(CURDIR)/tests/corpus/$*

fuzz-peers: $(VENV)/.installed-test
	$(BIN)/python tests/fuzz/peers.py --seconds $(FUZZ_SECONDS)

fuzz-keep: $(FUZZ_C:%=fuzz-keep-%)
$(FUZZ_C:%=fuzz-keep-%): fuzz-keep-%: build/fuzz/fuzz-%
	@mkdir -p build/fuzz/$* tests/corpus/$*
	$< -merge=1 -max_len=$(FUZZ_MAX_$*) tests/corpus/$* build/fuzz/$*

.SECONDEXPANSION:
FUZZ_NEEDS = tests/fuzz/$(1).c tests/firmware/fuzz/fuzz.c $(FUZZ_SOURCES_$(1):%=daemon/fmfts/$(FUZZ_FOLDER_$(1))/%.c)
FUZZ_HEADERS := $(wildcard tests/fuzz/*.h daemon/fmfts/arithmetic/*.h daemon/fmfts/sensor/*.h daemon/fmfts/sensor/wire/*.h daemon/fmfts/contact/*.h daemon/fmfts/pose/*.h daemon/fmfts/pipeline/*.h)

build/fuzz/fuzz-%: $$(call FUZZ_NEEDS,$$*) $(FUZZ_HEADERS) tests/firmware/fuzz/fuzz.h
	@mkdir -p $(dir $@)
	clang $(FUZZ_FLAGS) -fsanitize=fuzzer $(filter %.c,$^) -lm -o $@

build/fuzz/replay-%: $$(call FUZZ_NEEDS,$$*) tests/firmware/fuzz/replay.c $(FUZZ_HEADERS) tests/firmware/fuzz/fuzz.h
	@mkdir -p $(dir $@)
	gcc $(FUZZ_FLAGS) -O0 $(filter %.c,$^) -lm -o $@
