// The address is sent before START: nothing receives it.
#include "driver.h"

void scenario(void)
{
    select_channels(1);
    point_at(IDENTIFICATION);
    I2C1->CR1 |= START;
    I2C1->DR = SENSOR << 1 | 1;
    if (!await(ADDR))
        return;
    I2C1->CR1 &= ~(uint32_t)ACK;
    (void)I2C1->SR2;
    I2C1->CR1 |= STOP;
    await(RXNE);
    result.bytes[0] = (uint8_t)I2C1->DR;
}
