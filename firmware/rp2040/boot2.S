@ The second stage of the boot loader: the ROM copies these 256 bytes, with their checksum (uf2.py), into RAM and runs
@ them. They let the flash be read as memory, by the command that every SPI flash has, and start the program.
    .syntax unified
    .cpu cortex-m0plus
    .thumb
    .section .boot2, "ax"
    .thumb_func
    .global boot2
boot2:
    ldr r3, =0x18000000         @ SSI [4.10.13]
    movs r1, #0
    str r1, [r3, #0x08]         @ SSIENR: off while it is set up
    movs r1, #4
    str r1, [r3, #0x14]         @ BAUDR: 31 MHz at 125; command 03h goes up to 50 on a W25Q16JV
    ldr r1, =(31 << 16 | 3 << 8)
    str r1, [r3, #0x00]         @ CTRLR0: words of 32 bits, "EEPROM read", one data line
    movs r1, #0
    str r1, [r3, #0x04]         @ CTRLR1: one word
    ldr r1, =(0x03 << 24 | 2 << 8 | 6 << 2)
    ldr r0, =0x180000F4
    str r1, [r0]                @ SPI_CTRLR0: command 03h of 8 bits, address of 24
    movs r1, #1
    str r1, [r3, #0x08]
    ldr r0, =0x10000100         @ the program's vectors
    ldr r1, =0xE000ED08
    str r0, [r1]                @ VTOR
    ldr r1, [r0, #4]
    ldr r0, [r0]
    msr msp, r0
    bx r1
    .ltorg
