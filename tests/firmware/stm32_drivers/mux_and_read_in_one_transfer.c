// Select and read joined by a repeated START: the channel is not connected before the STOP (TCA9548A data sheet 8.5.1).
#include "driver.h"

void scenario(void)
{
    transmit(MUX, 1);
    if (!transmit(SENSOR, IDENTIFICATION)) {
        result.failed++;
        stop();
        return;
    }
    call(SENSOR, true);
    I2C1->CR1 &= ~(uint32_t)ACK;
    (void)I2C1->SR2;
    I2C1->CR1 |= STOP;
    await(RXNE);
    result.bytes[0] = (uint8_t)I2C1->DR;
}
