// One byte, refused only after ADDR was cleared: too late as soon as an interrupt comes in between.
#include "driver.h"

void scenario(void)
{
    select_channels(1);
    for (int i = 0; i < 3; i++) {
        point_at((uint8_t)(IDENTIFICATION + i));
        I2C1->CR1 |= ACK;
        call(SENSOR, true);
        (void)I2C1->SR2;
        I2C1->CR1 &= ~(uint32_t)ACK;
        I2C1->CR1 |= STOP;
        await(RXNE);
        result.bytes[i] = (uint8_t)I2C1->DR;
        while (I2C1->CR1 & STOP && !result.failed)
            await(BTF);
    }
}
