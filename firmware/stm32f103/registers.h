// The registers and bits of the STM32F103C8 that this firmware uses, named as in the reference manual (RM0008) or, for
// those of the core, the programming manual (PM0056). tests/firmware/test_stm32_registers.py compares each with the
// SVD.
#ifndef FMFTS_REGISTERS_H
#define FMFTS_REGISTERS_H

#include <stdint.h>

struct rcc {
    volatile uint32_t CR, CFGR, CIR, APB2RSTR, APB1RSTR, AHBENR, APB2ENR, APB1ENR, BDCR, CSR;
};
#define RCC ((struct rcc *)0x40021000)
#define RCC_CR_HSION (1U << 0)
#define RCC_CR_HSEON (1U << 16)
#define RCC_CR_HSERDY (1U << 17)
#define RCC_CR_CSSON (1U << 19)
#define RCC_CR_PLLON (1U << 24)
#define RCC_CR_PLLRDY (1U << 25)
#define RCC_CFGR_SW_PLL (2U << 0)
#define RCC_CFGR_SWS (3U << 2)
#define RCC_CFGR_SWS_PLL (2U << 2)
#define RCC_CFGR_PPRE1_HALF (4U << 8)
#define RCC_CFGR_PLLSRC_HSE (1U << 16)
#define RCC_CFGR_PLLMUL_9 (7U << 18)
#define RCC_CFGR_PLLMUL_16 (14U << 18)
#define RCC_CIR_CSSF (1U << 7)
#define RCC_CIR_CSSC (1U << 23)
#define RCC_APB2ENR_IOPAEN (1U << 2)
#define RCC_APB2ENR_IOPBEN (1U << 3)
#define RCC_APB2ENR_USART1EN (1U << 14)
#define RCC_APB1ENR_I2C1EN (1U << 21)
#define RCC_APB1ENR_I2C2EN (1U << 22)
#define RCC_CSR_RMVF (1U << 24)
#define RCC_CSR_PINRSTF (1U << 26)
#define RCC_CSR_PORRSTF (1U << 27)
#define RCC_CSR_SFTRSTF (1U << 28)
#define RCC_CSR_IWDGRSTF (1U << 29)
#define RCC_CSR_WWDGRSTF (1U << 30)
#define RCC_CSR_LPWRRSTF (1U << 31)

struct flash {
    volatile uint32_t ACR;
};
#define FLASH ((struct flash *)0x40022000)
#define FLASH_ACR_LATENCY_2 (2U << 0)
#define FLASH_ACR_PRFTBE (1U << 4)

struct gpio {
    volatile uint32_t CRL, CRH, IDR, ODR, BSRR, BRR;
};
#define GPIOA ((struct gpio *)0x40010800)
#define GPIOB ((struct gpio *)0x40010C00)

struct i2c {
    volatile uint32_t CR1, CR2, OAR1, OAR2, DR, SR1, SR2, CCR, TRISE;
};
#define I2C1 ((struct i2c *)0x40005400)
#define I2C2 ((struct i2c *)0x40005800)
#define I2C_CR1_PE (1U << 0)
#define I2C_CR1_START (1U << 8)
#define I2C_CR1_STOP (1U << 9)
#define I2C_CR1_ACK (1U << 10)
#define I2C_CR1_POS (1U << 11)
#define I2C_CR1_SWRST (1U << 15)
#define I2C_SR1_SB (1U << 0)
#define I2C_SR1_ADDR (1U << 1)
#define I2C_SR1_BTF (1U << 2)
#define I2C_SR1_RxNE (1U << 6)
#define I2C_SR1_TxE (1U << 7)
#define I2C_SR1_BERR (1U << 8)
#define I2C_SR1_ARLO (1U << 9)
#define I2C_SR1_AF (1U << 10)
#define I2C_SR2_BUSY (1U << 1)
#define I2C_CCR_F_S (1U << 15)

struct usart {
    volatile uint32_t SR, DR, BRR, CR1, CR2, CR3, GTPR;
};
#define USART1 ((struct usart *)0x40013800)
#define USART1_IRQ 37
#define USART1_SR_ORE (1U << 3)
#define USART1_SR_RXNE (1U << 5)
#define USART1_SR_TXE (1U << 7)
#define USART1_CR1_RE (1U << 2)
#define USART1_CR1_TE (1U << 3)
#define USART1_CR1_RXNEIE (1U << 5)
#define USART1_CR1_TXEIE (1U << 7)
#define USART1_CR1_UE (1U << 13)

struct iwdg {
    volatile uint32_t KR, PR, RLR, SR;
};
#define IWDG ((struct iwdg *)0x40003000)

struct systick {
    volatile uint32_t CTRL, LOAD, VAL;
};
#define STK ((struct systick *)0xE000E010)
#define STK_CTRL_ENABLE (1U << 0)
#define STK_CTRL_TICKINT (1U << 1)
#define STK_CTRL_CLKSOURCE (1U << 2)

struct nvic_enable {
    volatile uint32_t ISER0, ISER1;
};
#define NVIC ((struct nvic_enable *)0xE000E100)

struct scb {
    volatile uint32_t CPUID, ICSR, VTOR, AIRCR;
};
#define SCB ((struct scb *)0xE000ED00)
#define SCB_ICSR_PENDSTSET (1U << 26)
#define SCB_AIRCR_SYSRESETREQ (1U << 2)
#define SCB_AIRCR_VECTKEYSTAT_WRITE (0x5FAU << 16)

// RM0008 30.2: the 96-bit unique device id.
#define UNIQUE_ID ((const volatile uint32_t *)0x1FFFF7E8)

#endif
