#include "i2c.h"

#include <stdbool.h>

#include "i2c_recovery.h"
#include "timer.h"

enum {
    FREE_LIMIT_US = 100,      // wait for the bus to become free; the last STOP ends before a transfer begins
    TRANSFER_LIMIT_US = 1000, // the longest transfer of the core takes 0.25 ms
};

static bool is_late(const struct i2c_port *port, uint32_t limit_us)
{
    return timer_now_us() - port->begun_us > limit_us;
}

static enum bus_result await(const struct i2c_port *port, uint32_t event)
{
    for (;;) {
        uint32_t status = port->registers->SR1;
        if (status & (I2C_SR1_BERR | I2C_SR1_ARLO))
            return BUS_ARBITRATION;
        if (status & I2C_SR1_AF)
            return BUS_NO_ANSWER;
        if (status & event)
            return BUS_OK;
        if (is_late(port, TRANSFER_LIMIT_US))
            return BUS_TIMEOUT;
    }
}

static enum bus_result begin(struct i2c_port *port)
{
    port->begun_us = timer_now_us();
    while (port->registers->SR2 & I2C_SR2_BUSY)
        if (is_late(port, FREE_LIMIT_US))
            return BUS_STUCK;
    return BUS_OK;
}

// (Repeated) START and address. On success ADDR is set and the port holds SCL low.
static enum bus_result call(const struct i2c_port *port, uint8_t address_byte)
{
    port->registers->CR1 |= I2C_CR1_START;
    enum bus_result result = await(port, I2C_SR1_SB);
    if (result != BUS_OK)
        return result;
    port->registers->DR = address_byte;
    return await(port, I2C_SR1_ADDR);
}

// Reading SR1 and then SR2 clears ADDR; `await` has read SR1.
static void clear_addr(const struct i2c_port *port)
{
    (void)port->registers->SR2;
}

static enum bus_result send(const struct i2c_port *port, uint8_t address, const uint8_t *bytes, size_t count)
{
    enum bus_result result = call(port, (uint8_t)(address << 1));
    if (result != BUS_OK)
        return result;
    clear_addr(port);
    for (size_t i = 0; i < count && result == BUS_OK; i++) {
        result = await(port, I2C_SR1_TxE);
        if (result == BUS_OK)
            port->registers->DR = bytes[i];
    }
    return count > 0 && result == BUS_OK ? await(port, I2C_SR1_BTF) : result;
}

// Interrupts are blocked where a delay of one byte would send STOP a byte late, or read the last byte shifted (errata
// sheet ES096, "wrong data read into data register").
static void hold_interrupts(void)
{
    __asm__ volatile("cpsid i" ::: "memory");
}

static void release_interrupts(void)
{
    __asm__ volatile("cpsie i" ::: "memory");
}

// One byte: ACK is switched off before ADDR is cleared, and STOP is requested before the byte has arrived.
static enum bus_result receive_one(const struct i2c_port *port, uint8_t *bytes)
{
    struct i2c *i2c = port->registers;
    i2c->CR1 &= ~I2C_CR1_ACK;
    hold_interrupts();
    clear_addr(port);
    i2c->CR1 |= I2C_CR1_STOP;
    release_interrupts();
    enum bus_result result = await(port, I2C_SR1_RxNE);
    bytes[0] = (uint8_t)i2c->DR;
    return result;
}

// Two bytes: with POS, only the second gets no ACK. Both wait, in DR and in the shift register, until STOP is
// requested.
static enum bus_result receive_two(const struct i2c_port *port, uint8_t *bytes)
{
    struct i2c *i2c = port->registers;
    hold_interrupts();
    clear_addr(port);
    i2c->CR1 &= ~I2C_CR1_ACK;
    release_interrupts();
    enum bus_result result = await(port, I2C_SR1_BTF);
    if (result != BUS_OK)
        return result;
    hold_interrupts();
    i2c->CR1 |= I2C_CR1_STOP;
    bytes[0] = (uint8_t)i2c->DR;
    release_interrupts();
    bytes[1] = (uint8_t)i2c->DR;
    return BUS_OK;
}

// Three or more: before the last three, the port stops the clock (BTF), and ACK is switched off for the last one.
static enum bus_result receive_many(const struct i2c_port *port, uint8_t *bytes, size_t count)
{
    struct i2c *i2c = port->registers;
    enum bus_result result = BUS_OK;
    clear_addr(port);
    for (size_t i = 0; i < count - 3; i++) {
        result = await(port, I2C_SR1_RxNE);
        if (result != BUS_OK)
            return result;
        bytes[i] = (uint8_t)i2c->DR;
    }
    result = await(port, I2C_SR1_BTF);
    if (result != BUS_OK)
        return result;
    i2c->CR1 &= ~I2C_CR1_ACK;
    hold_interrupts();
    bytes[count - 3] = (uint8_t)i2c->DR;
    i2c->CR1 |= I2C_CR1_STOP;
    bytes[count - 2] = (uint8_t)i2c->DR;
    release_interrupts();
    result = await(port, I2C_SR1_RxNE);
    bytes[count - 1] = (uint8_t)i2c->DR;
    return result;
}

static enum bus_result receive(const struct i2c_port *port, uint8_t address, uint8_t *bytes, size_t count)
{
    struct i2c *i2c = port->registers;
    i2c->CR1 |= count == 2 ? I2C_CR1_ACK | I2C_CR1_POS : I2C_CR1_ACK;
    enum bus_result result = call(port, (uint8_t)(address << 1 | 1));
    if (result != BUS_OK)
        return result;
    return count == 1 ? receive_one(port, bytes) : count == 2 ? receive_two(port, bytes) : receive_many(port, bytes, count);
}

// Requests STOP unless the receiver did, and waits until it was sent: CR1 may not be written before. It does not wait
// until the bus is free: STOP may connect a mux channel that is held low, and that error belongs to the next transfer.
static enum bus_result end(const struct i2c_port *port, enum bus_result result, bool stop_asked)
{
    struct i2c *i2c = port->registers;
    i2c->SR1 = (uint32_t) ~(I2C_SR1_AF | I2C_SR1_BERR | I2C_SR1_ARLO);
    if (result != BUS_OK && result != BUS_NO_ANSWER)
        return result; // `recover` resets the port
    if (!stop_asked)
        i2c->CR1 |= I2C_CR1_STOP;
    while (i2c->CR1 & I2C_CR1_STOP)
        if (is_late(port, TRANSFER_LIMIT_US))
            return BUS_TIMEOUT;
    i2c->CR1 &= ~(I2C_CR1_ACK | I2C_CR1_POS);
    return result;
}

static enum bus_result write(void *context, uint8_t address, const uint8_t *bytes, size_t count)
{
    struct i2c_port *port = context;
    enum bus_result result = begin(port);
    if (result == BUS_OK)
        result = send(port, address, bytes, count);
    return end(port, result, false);
}

static enum bus_result read(void *context, uint8_t address, uint8_t *bytes, size_t count)
{
    struct i2c_port *port = context;
    enum bus_result result = begin(port);
    if (result == BUS_OK)
        result = receive(port, address, bytes, count);
    return end(port, result, result == BUS_OK);
}

static enum bus_result read_register(void *context, uint8_t address, uint8_t number, uint8_t *bytes, size_t count)
{
    struct i2c_port *port = context;
    enum bus_result result = begin(port);
    if (result == BUS_OK)
        result = send(port, address, &number, 1);
    if (result != BUS_OK)
        return end(port, result, false);
    result = receive(port, address, bytes, count);
    return end(port, result, result == BUS_OK);
}

enum bus_result i2c_start(struct i2c_port *port, struct bus *bus)
{
    *bus = (struct bus){write, read, read_register, i2c_recover, port};
    return i2c_recover(port);
}
