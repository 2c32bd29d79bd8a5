#include "driver.h"

__attribute__((section(".result"))) struct result result;

enum { PATIENCE = 2000 };

static void reset_handler(void)
{
    volatile uint32_t *rcc = (uint32_t *)0x40021000;
    rcc[6] = 1 << 3;  // APB2ENR: port B
    rcc[7] = 1 << 21; // APB1ENR: I2C1
    GPIOB->BSRR = 1 << SCL | 1 << SDA;
    GPIOB->CRL = 0xEE444444; // alternate function, open drain
    start_port();
    scenario();
    result.finished = 1;
    for (;;)
        __asm__ volatile("wfi");
}

__attribute__((section(".vectors"), used)) static void *const vectors[] = {(void *)0x20005000, (void *)reset_handler};

void start_port(void)
{
    I2C1->CR2 = 8;              // MHz, HSI
    I2C1->CCR = 1 << 15 | 7;    // 381 kHz
    I2C1->TRISE = 3;            // 300 ns
    I2C1->CR1 = PE;
}

bool await(uint32_t flags)
{
    for (int i = 0; i < PATIENCE; i++)
        if (I2C1->SR1 & flags)
            return true;
    result.failed++;
    return false;
}

bool call(uint8_t address, bool reading)
{
    I2C1->CR1 |= START;
    if (!await(SB))
        return false;
    I2C1->DR = (uint32_t)(address << 1 | reading);
    return await(ADDR | AF) && !(I2C1->SR1 & AF);
}

bool transmit(uint8_t address, uint8_t byte)
{
    if (!call(address, false))
        return false;
    (void)I2C1->SR2;
    I2C1->DR = byte;
    return await(BTF);
}

void stop(void)
{
    I2C1->CR1 |= STOP;
    for (int i = 0; i < PATIENCE && I2C1->CR1 & STOP; i++) {
    }
}

void select_channels(uint8_t channels)
{
    transmit(MUX, channels);
    stop();
}

void point_at(uint8_t number)
{
    transmit(SENSOR, number);
    stop();
}
