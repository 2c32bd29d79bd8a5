// Two bytes without POS: the second is refused too late, so a third follows.
#include "driver.h"

void scenario(void)
{
    select_channels(1);
    for (int i = 0; i < 2; i++) {
        point_at(IDENTIFICATION);
        I2C1->CR1 |= ACK;
        call(SENSOR, true);
        (void)I2C1->SR2;
        await(BTF);
        I2C1->CR1 &= ~(uint32_t)ACK;
        result.bytes[2 * i] = (uint8_t)I2C1->DR;
        result.bytes[2 * i + 1] = (uint8_t)I2C1->DR;
        stop();
    }
}
