// The registers of the RP2040 that this firmware uses, by its data sheet (chapters in brackets).
#ifndef FMFTS_RP2040_REGISTERS_H
#define FMFTS_RP2040_REGISTERS_H

#include <stdint.h>

#define AT(type, address) ((volatile struct type *)(address))

struct resets { // [2.14]
    uint32_t RESET, WDSEL, RESET_DONE;
};
#define RESETS AT(resets, 0x4000C000)
#define RESETS_I2C0 (1U << 3)
#define RESETS_I2C1 (1U << 4)
#define RESETS_IO_BANK0 (1U << 5)
#define RESETS_PADS_BANK0 (1U << 8)
#define RESETS_PLL_SYS (1U << 12)
#define RESETS_PLL_USB (1U << 13)
#define RESETS_TIMER (1U << 21)
#define RESETS_UART0 (1U << 22)
#define RESETS_USBCTRL (1U << 24)

struct clock_generator { // [2.15.7]
    uint32_t CTRL, DIV, SELECTED;
};
#define CLK_REF AT(clock_generator, 0x40008030)
#define CLK_SYS AT(clock_generator, 0x4000803C)
#define CLK_PERI AT(clock_generator, 0x40008048)
#define CLK_USB AT(clock_generator, 0x40008054)
#define CLK_REF_XOSC 2U
#define CLK_SYS_REF 0U
#define CLK_SYS_AUX 1U // its source 0 is the PLL
#define CLK_ENABLE (1U << 11) // CLK_PERI from CLK_SYS, CLK_USB from PLL_USB

struct xosc { // [2.16.7]
    uint32_t CTRL, STATUS, DORMANT, STARTUP;
};
#define XOSC AT(xosc, 0x40024000)
#define XOSC_ENABLE (0xFABU << 12 | 0xAA0U) // 1 to 15 MHz
#define XOSC_STABLE (1U << 31)

struct pll { // [2.18.4]
    uint32_t CS, PWR, FBDIV_INT, PRIM;
};
#define PLL_SYS AT(pll, 0x40028000)
#define PLL_USB AT(pll, 0x4002C000)
#define PLL_LOCK (1U << 31)
#define PLL_PWR_PD (1U << 0)
#define PLL_PWR_POSTDIVPD (1U << 3)
#define PLL_PWR_VCOPD (1U << 5)

struct psm { // [2.13.5]
    uint32_t FRCE_ON, FRCE_OFF, WDSEL;
};
#define PSM AT(psm, 0x40010000)
#define PSM_ALL_BUT_OSCILLATORS 0x1FFFCU

struct watchdog { // [4.7.6]
    uint32_t CTRL, LOAD, REASON, SCRATCH[8], TICK;
};
#define WATCHDOG AT(watchdog, 0x40058000)
#define WATCHDOG_ENABLE (1U << 30)
#define WATCHDOG_TRIGGER (1U << 31)
#define WATCHDOG_REASON_TIMER (1U << 0)
#define WATCHDOG_REASON_FORCE (1U << 1)
#define WATCHDOG_TICK_ENABLE (1U << 9)

#define CHIP_RESET (*(volatile uint32_t *)0x40064008) // [2.12.8]
#define CHIP_RESET_HAD_POR (1U << 8)
#define CHIP_RESET_HAD_RUN (1U << 16)

#define TIMERAWL (*(volatile uint32_t *)0x40054028) // [4.6.5] microseconds

struct io_bank { // [2.19.6.1]
    struct {
        uint32_t STATUS, CTRL;
    } GPIO[30];
};
#define IO_BANK0 AT(io_bank, 0x40014000)
#define FUNCTION_UART 2U
#define FUNCTION_I2C 3U
#define FUNCTION_SIO 5U

struct pads_bank { // [2.19.6.3]
    uint32_t VOLTAGE_SELECT, GPIO[30];
};
#define PADS_BANK0 AT(pads_bank, 0x4001C000)
#define PAD_PULLED_UP 0x5AU // input, Schmitt trigger, 4 mA, pull-up

struct sio { // [2.3.1.7]
    uint32_t CPUID, GPIO_IN, GPIO_HI_IN, unused_0, GPIO_OUT, GPIO_OUT_SET, GPIO_OUT_CLR, GPIO_OUT_XOR, GPIO_OE, GPIO_OE_SET,
        GPIO_OE_CLR;
};
#define SIO AT(sio, 0xD0000000)

struct uart { // [4.2.8]
    uint32_t DR, RSR, unused_0[4], FR, unused_1, ILPR, IBRD, FBRD, LCR_H, CR, IFLS, IMSC, RIS, MIS, ICR;
};
#define UART0 AT(uart, 0x40034000)
#define UART0_IRQ 20
#define UART_FR_RXFE (1U << 4)
#define UART_FR_TXFF (1U << 5)
#define UART_LCR_H_8_BITS (3U << 5)
#define UART_LCR_H_FEN (1U << 4)
#define UART_CR_UARTEN (1U << 0)
#define UART_CR_TXE (1U << 8)
#define UART_CR_RXE (1U << 9)
#define UART_INT_RX (1U << 4)
#define UART_INT_TX (1U << 5)
#define UART_INT_RT (1U << 6) // bytes are waiting, and the line is idle

struct i2c { // [4.3.17]
    uint32_t CON, TAR, SAR, unused_0, DATA_CMD, SS_SCL_HCNT, SS_SCL_LCNT, FS_SCL_HCNT, FS_SCL_LCNT, unused_1[2], INTR_STAT,
        INTR_MASK, RAW_INTR_STAT, RX_TL, TX_TL, CLR_INTR, CLR_RX_UNDER, CLR_RX_OVER, CLR_TX_OVER, CLR_RD_REQ, CLR_TX_ABRT,
        CLR_RX_DONE, CLR_ACTIVITY, CLR_STOP_DET, CLR_START_DET, CLR_GEN_CALL, ENABLE, STATUS, TXFLR, RXFLR, SDA_HOLD,
        TX_ABRT_SOURCE, unused_2[7], FS_SPKLEN;
};
#define I2C0 AT(i2c, 0x40044000)
#define I2C1 AT(i2c, 0x40048000)
#define I2C_CON_MASTER_FAST 0x0165U // [4.3.10.2.1] master, fast mode, restarts, no slave, TX_EMPTY when it has been sent
#define I2C_DATA_READ (1U << 8)
#define I2C_DATA_STOP (1U << 9)
#define I2C_DATA_RESTART (1U << 10)
#define I2C_INTR_TX_ABRT (1U << 6)
#define I2C_INTR_STOP_DET (1U << 9)
#define I2C_STATUS_TFNF (1U << 1)
#define I2C_STATUS_RFNE (1U << 3)
#define I2C_ABRT_NOACK 0x0FU // no acknowledge of an address or of data

struct ssi { // [4.10.13] between the processor and the flash
    uint32_t CTRLR0, CTRLR1, SSIENR, MWCR, SER, BAUDR, TXFTLR, RXFTLR, TXFLR, RXFLR, SR, unused_0[13], DR0;
};
#define SSI AT(ssi, 0x18000000)
#define SSI_CTRLR0_BYTES (7U << 16) // frames of 8 bits, sent and received at once
#define SSI_SR_RFNE (1U << 3)

#define QSPI_SELECT (*(volatile uint32_t *)0x4001800C) // [2.19.6.2] GPIO_QSPI_SS_CTRL
#define QSPI_SELECT_BY_SSI 0U
#define QSPI_SELECT_LOW (2U << 8)
#define QSPI_SELECT_HIGH (3U << 8)

struct nvic {
    uint32_t ISER;
};
#define NVIC AT(nvic, 0xE000E100)

#endif
