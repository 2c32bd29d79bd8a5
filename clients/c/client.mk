# The C client. The main Makefile includes this if it exists: the sources of the Debian package do not have it.
C_CLIENT_PACKAGES = $(call missing_packages,libzmq3-dev cmake pkg-config gcc)
C_CLIENT_BUILD := build/c-client
C_CLIENT_FUZZ_RUNS ?= 1000000

.PHONY: install-c-client fuzz-c-client

# Installs header, library, fmfts.pc and CMake's files into PREFIX.
install-c-client:
	@$(call need,$(C_CLIENT_PACKAGES),exit 1)
	cmake -S clients/c -B $(C_CLIENT_BUILD) -DCMAKE_INSTALL_PREFIX="$(PREFIX)"
	cmake --build $(C_CLIENT_BUILD)
	DESTDIR="$(DESTDIR)" cmake --install $(C_CLIENT_BUILD)

# Sends a million messages to the decoder; inputs that fail are kept in build/fuzz-c-client.
fuzz-c-client: test-packages build/fuzz-c-client/decoder
	mkdir -p build/fuzz-c-client/found
	cd build/fuzz-c-client && ./decoder -seed=1 -runs=$(C_CLIENT_FUZZ_RUNS) -max_len=2048 -print_final_stats=1 found $(CURDIR)/tests/c_client/corpus

build/fuzz-c-client/decoder: tests/c_client/fuzz_decoder.c clients/c/fmfts.c clients/c/fmfts.h
	mkdir -p $(dir $@)
	clang -std=c11 -g -O1 -Wall -Wextra -Werror -Wconversion -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all $(filter %.c,$^) -lzmq -o $@
