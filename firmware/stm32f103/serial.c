#include "serial.h"

#include "../core/ring.h"
#include "gpio.h"
#include "registers.h"
#include "startup.h"

enum {
    BAUD = 460800,
    TRANSMIT_PIN = 9, // of port A
    RECEIVE_PIN = 10,
    TRANSMIT_SIZE = 512, // 11 ms of line
    RECEIVE_SIZE = 256,  // 5.6 ms; the main loop empties it more often
};

static uint8_t transmit_bytes[TRANSMIT_SIZE], receive_bytes[RECEIVE_SIZE];
static struct ring transmit, receive;

void serial_start(uint32_t apb2_mhz)
{
    ring_init(&transmit, transmit_bytes, TRANSMIT_SIZE);
    ring_init(&receive, receive_bytes, RECEIVE_SIZE);
    gpio_configure(GPIOA, TRANSMIT_PIN, GPIO_ALTERNATE_PUSH_PULL);
    gpio_set(GPIOA, RECEIVE_PIN, true); // pulled up: an unconnected line is idle, not a break
    gpio_configure(GPIOA, RECEIVE_PIN, GPIO_PULLED_INPUT);
    // BRR holds clock cycles per bit, rounded. The rate is 0.2 % off at 72 MHz, 0.1 % at 64 MHz.
    USART1->BRR = (apb2_mhz * 1000000U + BAUD / 2) / BAUD;
    USART1->CR1 = USART1_CR1_UE | USART1_CR1_TE | USART1_CR1_RE | USART1_CR1_RXNEIE;
    NVIC->ISER1 = 1U << (USART1_IRQ - 32);
    const uint8_t zero = 0; // ends a packet that the reset cut off, so that the hello after it is whole
    serial_send(NULL, &zero, 1);
}

bool serial_send(void *context, const uint8_t *line, size_t count)
{
    (void)context;
    bool taken = ring_put(&transmit, line, count);
    // Safe against the handler: it clears TXEIE only when the ring is empty, and the ring is not empty now.
    USART1->CR1 |= USART1_CR1_TXEIE;
    return taken;
}

const uint8_t *serial_peek(size_t *count)
{
    return ring_peek(&receive, count);
}

void serial_drop(size_t count)
{
    ring_drop(&receive, count);
}

void usart1_handler(void)
{
    uint32_t status = USART1->SR;
    if (status & (USART1_SR_RXNE | USART1_SR_ORE)) {
        uint8_t byte = (uint8_t)USART1->DR; // also clears ORE; the packet's CRC shows lost or wrong bytes
        if (status & USART1_SR_RXNE)
            ring_put(&receive, &byte, 1);
    }
    if ((status & USART1_SR_TXE) && (USART1->CR1 & USART1_CR1_TXEIE)) {
        size_t count;
        const uint8_t *next = ring_peek(&transmit, &count);
        if (count > 0) {
            USART1->DR = *next;
            ring_drop(&transmit, 1);
        } else {
            USART1->CR1 &= ~USART1_CR1_TXEIE;
        }
    }
}
