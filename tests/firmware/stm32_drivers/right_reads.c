// The receive sequences of RM0008 26.3.3 (and AN2824) for one, two and three or more bytes.
#include "driver.h"

static void read_one(uint8_t *bytes)
{
    call(SENSOR, true);
    I2C1->CR1 &= ~(uint32_t)ACK; // before ADDR is cleared
    (void)I2C1->SR2;
    I2C1->CR1 |= STOP;
    await(RXNE);
    bytes[0] = (uint8_t)I2C1->DR;
}

static void read_two(uint8_t *bytes)
{
    I2C1->CR1 |= ACK | POS;
    call(SENSOR, true);
    (void)I2C1->SR2;
    I2C1->CR1 &= ~(uint32_t)ACK;
    await(BTF);
    I2C1->CR1 |= STOP;
    bytes[0] = (uint8_t)I2C1->DR;
    bytes[1] = (uint8_t)I2C1->DR;
}

static void read_many(uint8_t *bytes, int count)
{
    I2C1->CR1 |= ACK;
    call(SENSOR, true);
    (void)I2C1->SR2;
    for (int i = 0; i < count - 3; i++) {
        await(RXNE);
        bytes[i] = (uint8_t)I2C1->DR;
    }
    await(BTF);
    I2C1->CR1 &= ~(uint32_t)ACK;
    bytes[count - 3] = (uint8_t)I2C1->DR;
    I2C1->CR1 |= STOP;
    bytes[count - 2] = (uint8_t)I2C1->DR;
    await(RXNE);
    bytes[count - 1] = (uint8_t)I2C1->DR;
}

// The manual's other sequence: ACK and STOP after the last but one byte, while the last is being received.
static void read_byte_by_byte(uint8_t *bytes, int count)
{
    I2C1->CR1 |= ACK;
    call(SENSOR, true);
    (void)I2C1->SR2;
    for (int i = 0; i < count; i++) {
        await(RXNE);
        bytes[i] = (uint8_t)I2C1->DR;
        if (i == count - 2) {
            I2C1->CR1 &= ~(uint32_t)ACK;
            I2C1->CR1 |= STOP;
        }
    }
}

static void settle(void)
{
    while (I2C1->CR1 & STOP) {
    }
    I2C1->CR1 &= ~(uint32_t)(ACK | POS);
    point_at(IDENTIFICATION);
}

void scenario(void)
{
    uint8_t *bytes = result.bytes;
    select_channels(1);
    point_at(IDENTIFICATION);
    for (int i = 0; i < 2; i++, bytes += 1) {
        read_one(bytes);
        settle();
    }
    for (int i = 0; i < 2; i++, bytes += 2) {
        read_two(bytes);
        settle();
    }
    for (int i = 0; i < 2; i++, bytes += 3) {
        read_many(bytes, 3);
        settle();
    }
    read_byte_by_byte(bytes, 3);
    settle();
    point_at(3);
    read_many(bytes + 3, 10);
}
