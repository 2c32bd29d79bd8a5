// ADDR is cleared by SR1 and then SR2; the second is missing, and SCL stays low.
#include "driver.h"

void scenario(void)
{
    select_channels(1);
    call(SENSOR, true);
    await(RXNE);
    result.bytes[0] = (uint8_t)I2C1->DR;
}
