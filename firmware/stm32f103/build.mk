# The firmware for the chip, by GCC, and by clang as a check with a second compiler. ../Makefile includes this.
ARM_CC ?= arm-none-eabi-gcc
CLANG ?= clang
OPENOCD ?= openocd
STM32FLASH ?= stm32flash

STM32 = $(CORE) $(wildcard cortex_m/*.c stm32f103/*.c)
STM32_SCRIPT = stm32f103/stm32f103c8.ld
STM32_HEADERS = $(wildcard core/*.h core/chips/*.h cortex_m/*.h cortex_m/freestanding/*.h stm32f103/*.h)
STM32_FLAGS = -mcpu=cortex-m3 -mthumb -g $(WARNINGS) -ffreestanding -ffunction-sections -fdata-sections \
	-isystem cortex_m/freestanding -nostdlib -Wl,--gc-sections,--fatal-warnings -T $(STM32_SCRIPT)
# Without the flag, GCC compiles the loop in memcpy to a call of memcpy.
STM32_GCC = $(ARM_CC) -fno-tree-loop-distribute-patterns
# With -Os clang inlines and unrolls so much that the image does not fit.
STM32_CLANG = $(CLANG) --target=thumbv7m-none-eabi -fno-builtin -fuse-ld=lld

stm32: $(BUILD)/fmfts.elf $(BUILD)/fmfts.bin
	@sh cortex_m/size.sh $(ARM_CC) $< 20 4

stm32-clang: $(BUILD)/fmfts-clang.elf
	@sh cortex_m/size.sh $(ARM_CC) $< 20 4

$(BUILD)/fmfts.elf: $(STM32) $(STM32_HEADERS) $(STM32_SCRIPT) stm32f103/build.mk
	@mkdir -p $(BUILD)
	$(STM32_GCC) -Os $(STM32_FLAGS) $(filter %.c,$^) -Wl,-Map=$(BUILD)/fmfts.map -o $@.$$$$ && mv $@.$$$$ $@

$(BUILD)/fmfts-clang.elf: $(STM32) $(STM32_HEADERS) $(STM32_SCRIPT) stm32f103/build.mk
	@mkdir -p $(BUILD)
	$(STM32_CLANG) -Oz $(STM32_FLAGS) $(filter %.c,$^) -Wl,-Map=$(BUILD)/fmfts-clang.map -o $@.$$$$ && mv $@.$$$$ $@

$(BUILD)/fmfts.bin: $(BUILD)/fmfts.elf
	$(ARM_CC:gcc=objcopy) -O binary $< $@.$$$$ && mv $@.$$$$ $@

# An ST-Link on SWDIO, SWCLK and GND.
flash: $(BUILD)/fmfts.elf
	$(OPENOCD) -f interface/stlink.cfg -f target/stm32f1x.cfg -c "program $< verify reset exit"

# The chip's own boot loader on USART1, BOOT0 at 1: docs/firmware.md.
flash-serial: $(BUILD)/fmfts.bin
	@test -n "$(PORT)" || { echo "say which port: make flash-serial PORT=/dev/serial/by-id/…" >&2; exit 2; }
	$(STM32FLASH) -b 115200 -w $< -v -g 0x08000000 $(PORT)
