# Fuzzing of what the host's bytes meet on the board. Included by firmware/Makefile.
#   make fuzz        a million inputs to each target, from the kept corpus on; what it finds stays in build/fuzz
#   make fuzz-keep   what of that adds coverage joins the kept corpus
FUZZ = $(TESTS)/fuzz
CORPUS = $(TESTS)/corpus
FUZZ_RUNS ?= 1000000
FUZZ_SANITIZERS = -fsanitize=address,undefined -fno-sanitize-recover=all
FUZZ_SOURCES = $(FUZZ)/fuzz.c $(CORE) $(EMULATED) host/emulation.c
FUZZ_TARGETS = decoder requests
# Longer than any line; some ten requests, which is what a second of fuzzing can afford.
FUZZ_MAX_decoder = 300
FUZZ_MAX_requests = 64

fuzz: $(FUZZ_TARGETS:%=fuzz-%)
fuzz-keep: $(FUZZ_TARGETS:%=fuzz-keep-%)

fuzz-%: $(BUILD)/fuzz-%
	@mkdir -p $(BUILD)/fuzz/$*
	$< -seed=1 -runs=$(FUZZ_RUNS) -max_len=$(FUZZ_MAX_$*) -print_final_stats=1 $(BUILD)/fuzz/$* $(CORPUS)/$*

fuzz-keep-%: $(BUILD)/fuzz-%
	$< -set_cover_merge=1 $(CORPUS)/$* $(BUILD)/fuzz/$*

$(BUILD)/fuzz-%: $(FUZZ)/%.c $(FUZZ_SOURCES) $(HEADERS) $(FUZZ)/fuzz.h
	@mkdir -p $(BUILD)
	$(CLANG) $(WARNINGS) -g -O1 -fsanitize=fuzzer $(FUZZ_SANITIZERS) $(filter %.c,$^) -o $@ -lm

$(BUILD)/replay-%: $(FUZZ)/%.c $(FUZZ)/replay.c $(FUZZ_SOURCES) $(HEADERS) $(FUZZ)/fuzz.h
	$(call compile,$(FUZZ_SANITIZERS))
