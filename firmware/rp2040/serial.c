#include "serial.h"

#include "../core/ring.h"
#include "registers.h"
#include "startup.h"

enum {
    BAUD = 460800,
    TRANSMIT_PIN = 0,
    RECEIVE_PIN = 1,
    TRANSMIT_SIZE = 512, // 11 ms of line
    RECEIVE_SIZE = 256,
};

static uint8_t transmit_bytes[TRANSMIT_SIZE], receive_bytes[RECEIVE_SIZE];
static struct ring transmit, receive;

void serial_start(uint32_t peripheral_hz)
{
    ring_init(&transmit, transmit_bytes, TRANSMIT_SIZE);
    ring_init(&receive, receive_bytes, RECEIVE_SIZE);
    PADS_BANK0->GPIO[RECEIVE_PIN] = PAD_PULLED_UP; // an unconnected line is idle, not a break
    IO_BANK0->GPIO[TRANSMIT_PIN].CTRL = FUNCTION_UART;
    IO_BANK0->GPIO[RECEIVE_PIN].CTRL = FUNCTION_UART;
    uint32_t divisor = (peripheral_hz * 4 + BAUD / 2) / BAUD; // 16 cycles a bit, in 64ths: 0.01 % off at 125 MHz
    UART0->IBRD = divisor >> 6;
    UART0->FBRD = divisor & 63;
    UART0->LCR_H = UART_LCR_H_8_BITS | UART_LCR_H_FEN;
    UART0->IFLS = 0; // interrupts when the receiver has four bytes, and when the transmitter has no more than four
    UART0->IMSC = UART_INT_RX | UART_INT_RT;
    UART0->CR = UART_CR_UARTEN | UART_CR_TXE | UART_CR_RXE;
    NVIC->ISER = 1U << UART0_IRQ;
    const uint8_t zero = 0; // ends a packet that the reset cut off, so that the hello after it is whole
    serial_send(NULL, &zero, 1);
}

// Its interrupt comes when the level falls, so not for bytes put into an empty buffer: these are sent here.
static void fill(void)
{
    size_t count;
    const uint8_t *next;
    while (!(UART0->FR & UART_FR_TXFF) && (next = ring_peek(&transmit, &count), count > 0)) {
        UART0->DR = *next;
        ring_drop(&transmit, 1);
    }
    ring_peek(&transmit, &count);
    UART0->IMSC = count > 0 ? UART_INT_RX | UART_INT_RT | UART_INT_TX : UART_INT_RX | UART_INT_RT;
}

bool serial_send(void *context, const uint8_t *line, size_t count)
{
    (void)context;
    bool taken = ring_put(&transmit, line, count);
    __asm__ volatile("cpsid i" ::: "memory");
    fill();
    __asm__ volatile("cpsie i" ::: "memory");
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

void uart0_handler(void)
{
    while (!(UART0->FR & UART_FR_RXFE)) {
        uint8_t byte = (uint8_t)UART0->DR; // the packet's CRC shows lost or wrong bytes
        ring_put(&receive, &byte, 1);
    }
    UART0->ICR = UART_INT_TX;
    fill();
}
