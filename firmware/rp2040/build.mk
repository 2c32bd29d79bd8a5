# The firmware for an RP2040, by GCC: a Raspberry Pi Pico, or a QT Py RP2040 with RP2040_BOARD=qtpy. ../Makefile includes this.
PYTHON ?= python3
RP2040_BOARD ?= pico
RP2040_BOARDS = pico qtpy
RP2040_IMAGE = $(BUILD)/fmfts-rp2040$(filter-out -pico,-$(RP2040_BOARD))
RP2040 = $(CORE) $(wildcard cortex_m/*.c rp2040/*.c) rp2040/boot2.S
RP2040_HEADERS = $(wildcard core/*.h core/chips/*.h cortex_m/*.h cortex_m/freestanding/*.h rp2040/*.h)
# Its core has no division: that is in the compiler's own library.
RP2040_FLAGS = -mcpu=cortex-m0plus -mthumb -g -Os $(WARNINGS) -ffreestanding -ffunction-sections -fdata-sections \
	$(if $(filter qtpy,$(RP2040_BOARD)),-DFMFTS_QTPY) -fno-tree-loop-distribute-patterns -isystem cortex_m/freestanding -nostdlib \
	-Wl,--gc-sections,--fatal-warnings -T rp2040/rp2040.ld

.PHONY: rp2040
rp2040: $(RP2040_IMAGE).uf2
	@sh cortex_m/size.sh $(ARM_CC) $(RP2040_IMAGE).elf 24 8

$(RP2040_IMAGE).elf: $(RP2040) $(RP2040_HEADERS) rp2040/rp2040.ld rp2040/build.mk
	$(if $(filter $(RP2040_BOARD),$(RP2040_BOARDS)),,$(error RP2040_BOARD=$(RP2040_BOARD) is no board with an RP2040 that this \
		firmware knows: one of $(RP2040_BOARDS)))
	@mkdir -p $(BUILD)
	$(ARM_CC) $(RP2040_FLAGS) $(filter %.c %.S,$^) -lgcc -o $@.$$$$ && mv $@.$$$$ $@

$(RP2040_IMAGE).uf2: $(RP2040_IMAGE).elf rp2040/uf2.py
	$(ARM_CC:gcc=objcopy) -O binary --gap-fill 0 $< $(RP2040_IMAGE).bin
	$(PYTHON) rp2040/uf2.py $(RP2040_IMAGE).bin $@.$$$$ && mv $@.$$$$ $@
