// STOP after the byte was read: the clock has continued, so one byte too many is received and read the next time.
#include "driver.h"

void scenario(void)
{
    select_channels(1);
    for (int i = 0; i < 3; i++) {
        point_at((uint8_t)(IDENTIFICATION + i));
        call(SENSOR, true);
        I2C1->CR1 &= ~(uint32_t)ACK;
        (void)I2C1->SR2;
        await(RXNE);
        result.bytes[i] = (uint8_t)I2C1->DR;
        stop();
    }
}
