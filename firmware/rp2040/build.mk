# The firmware for an RP2040 (Raspberry Pi Pico), by GCC. ../Makefile includes this.
PYTHON ?= python3
RP2040 = $(CORE) $(wildcard cortex_m/*.c rp2040/*.c) rp2040/boot2.S
RP2040_HEADERS = $(wildcard core/*.h core/chips/*.h cortex_m/*.h cortex_m/freestanding/*.h rp2040/*.h)
# Its core has no division: that is in the compiler's own library.
RP2040_FLAGS = -mcpu=cortex-m0plus -mthumb -g -Os $(WARNINGS) -ffreestanding -ffunction-sections -fdata-sections \
	-fno-tree-loop-distribute-patterns -isystem cortex_m/freestanding -nostdlib \
	-Wl,--gc-sections,--fatal-warnings -T rp2040/rp2040.ld

.PHONY: rp2040
rp2040: $(BUILD)/fmfts-rp2040.uf2
	@sh cortex_m/size.sh $(ARM_CC) $(BUILD)/fmfts-rp2040.elf 24 8

$(BUILD)/fmfts-rp2040.elf: $(RP2040) $(RP2040_HEADERS) rp2040/rp2040.ld rp2040/build.mk
	@mkdir -p $(BUILD)
	$(ARM_CC) $(RP2040_FLAGS) $(filter %.c %.S,$^) -lgcc -o $@.$$$$ && mv $@.$$$$ $@

$(BUILD)/fmfts-rp2040.uf2: $(BUILD)/fmfts-rp2040.elf rp2040/uf2.py
	$(ARM_CC:gcc=objcopy) -O binary --gap-fill 0 $< $(BUILD)/fmfts-rp2040.bin
	$(PYTHON) rp2040/uf2.py $(BUILD)/fmfts-rp2040.bin $@.$$$$ && mv $@.$$$$ $@
