// Two sensors answer at once, and a zero from either wins: plausible, and wrong.
#include "driver.h"

void scenario(void)
{
    select_channels(3);
    point_at(0x03);
    call(SENSOR, true);
    I2C1->CR1 &= ~(uint32_t)ACK;
    (void)I2C1->SR2;
    I2C1->CR1 |= STOP;
    await(RXNE);
    result.bytes[0] = (uint8_t)I2C1->DR;
}
