// SWRST alone does not clear a BUSY that is stuck (ES096); moving the lines by hand first does, as `moved` shows.
#include "driver.h"

static bool free_after_reset(void)
{
    I2C1->CR1 = SWRST;
    I2C1->CR1 = 0;
    start_port();
    return !(I2C1->SR2 & BUSY);
}

static bool moves(unsigned pin, bool high)
{
    GPIOB->BSRR = 1U << (high ? pin : pin + 16);
    return (GPIOB->IDR >> pin & 1) == high;
}

void scenario(void)
{
    while (!(I2C1->SR2 & BUSY)) {
    }
    result.bytes[0] = free_after_reset();
    I2C1->CR1 = 0;
    GPIOB->CRL = 0x66444444; // general purpose, open drain
    result.bytes[1] = moves(SDA, false) && moves(SCL, false) && moves(SCL, true) && moves(SDA, true);
    GPIOB->CRL = 0xEE444444;
    result.bytes[2] = free_after_reset();
}
