#include "usb_serial.h"

#include "../core/ring.h"
#include "registers.h"
#include "startup.h"
#include "usb_control.h"
#include "usb_registers.h"

enum {
    TRANSMIT_SIZE = 512,
    RECEIVE_SIZE = 256,
    FRAME_US = 1000,
    // Erratum RP2040-E15: certain errors of the bus in the last fifth of a frame hang the controller during a bulk
    // transfer to the host. A packet that becomes ready then waits for the next frame.
    SAFE_US = 800,
    // The time from reading the clock until the controller has the packet: 64 bytes are copied, which takes 7 us.
    FILLING_US = 20,
};

static uint8_t transmit_bytes[TRANSMIT_SIZE], receive_bytes[RECEIVE_SIZE];
static struct ring transmit, receive;
static volatile bool is_sending, has_received; // received bytes wait in the controller's memory for room
static bool ended_full, sends_data1, receives_data1;
static uint32_t frame_began_us;

// The host waits for more after a full packet, so an empty one marks the end.
static void send_next(void)
{
    size_t count = 0, run;
    const uint8_t *next = ring_peek(&transmit, &run);
    if (is_sending || (run == 0 && !ended_full) || (TIMERAWL - frame_began_us) % FRAME_US >= SAFE_US - FILLING_US)
        return;
    while (count < USB_PACKET && run > 0) {
        size_t taken = 0;
        while (taken < run && count < USB_PACKET)
            USB_MEMORY->bulk_in[count++] = next[taken++];
        ring_drop(&transmit, taken);
        next = ring_peek(&transmit, &run);
    }
    ended_full = count == USB_PACKET;
    is_sending = true;
    usb_arm(&USB_MEMORY->buffer[USB_BULK].in, (uint32_t)count, true, sends_data1);
    sends_data1 = !sends_data1;
}

static void let_host_send(void)
{
    usb_arm(&USB_MEMORY->buffer[USB_BULK].out, USB_PACKET, false, receives_data1);
    receives_data1 = !receives_data1;
}

static void take_received(void)
{
    uint8_t packet[USB_PACKET];
    size_t count = USB_MEMORY->buffer[USB_BULK].out & USB_BUFFER_LENGTH;
    for (size_t i = 0; i < count; i++)
        packet[i] = USB_MEMORY->bulk_out[i];
    has_received = count > 0 && !ring_put(&receive, packet, count);
    if (!has_received)
        let_host_send();
}

static uint32_t at(volatile uint8_t *memory)
{
    return (uint32_t)(memory - (volatile uint8_t *)USB_MEMORY);
}

static void open_endpoints(bool opened)
{
    const uint32_t on = opened ? USB_CONTROL_ENABLE | USB_CONTROL_INTERRUPT : 0;
    is_sending = has_received = ended_full = sends_data1 = receives_data1 = false;
    for (int endpoint = USB_NOTICES; endpoint <= USB_BULK; endpoint++)
        USB_MEMORY->buffer[endpoint].in = USB_MEMORY->buffer[endpoint].out = 0;
    USB_MEMORY->control[USB_NOTICES - 1].in = on | USB_CONTROL_INTERRUPT_TYPE | at(USB_MEMORY->notices);
    USB_MEMORY->control[USB_BULK - 1].in = on | USB_CONTROL_BULK | at(USB_MEMORY->bulk_in);
    USB_MEMORY->control[USB_BULK - 1].out = on | USB_CONTROL_BULK | at(USB_MEMORY->bulk_out);
    if (opened)
        let_host_send();
}

// A program that opens the port must not read what was sent before.
static void port_opened(void)
{
    size_t count;
    while (ring_peek(&transmit, &count), count > 0)
        ring_drop(&transmit, count);
}

static struct usb_control control = {.open_endpoints = open_endpoints, .port_opened = port_opened};

void usb_serial_start(const uint8_t id[BOARD_ID_SIZE])
{
    for (int i = 0; i < USB_SERIAL_DIGITS; i++)
        control.serial[i] = "0123456789ABCDEF"[id[i / 2] >> (i % 2 ? 0 : 4) & 15];
    ring_init(&transmit, transmit_bytes, TRANSMIT_SIZE);
    ring_init(&receive, receive_bytes, RECEIVE_SIZE);
    volatile uint32_t *memory = (volatile uint32_t *)USB_MEMORY;
    for (size_t i = 0; i < sizeof *USB_MEMORY / 4; i++)
        memory[i] = 0;
    USB->USB_MUXING = USB_MUXING_TO_PHY_SOFTCON;
    USB->USB_PWR = USB_PWR_VBUS_TAKEN_AS_THERE; // a board without USB never gets a request
    USB->MAIN_CTRL = USB_MAIN_CTRL_CONTROLLER_EN;
    USB->SIE_CTRL = USB_SIE_CTRL_EP0_INT_1BUF;
    USB->INTE = USB_INT_BUFF_STATUS | USB_INT_BUS_RESET | USB_INT_SETUP_REQ | USB_INT_DEV_SOF;
    NVIC->ISER = 1U << USBCTRL_IRQ;
    USB->SIE_CTRL = USB_SIE_CTRL_EP0_INT_1BUF | USB_SIE_CTRL_PULLUP_EN;
}

bool usb_serial_is_open(void)
{
    return control.terminal_ready && !(USB->SIE_STATUS & USB_SIE_STATUS_SUSPENDED);
}

bool usb_serial_send(const uint8_t *line, size_t count)
{
    bool taken = ring_put(&transmit, line, count);
    __asm__ volatile("cpsid i" ::: "memory");
    if (control.configured)
        send_next();
    __asm__ volatile("cpsie i" ::: "memory");
    return taken;
}

const uint8_t *usb_serial_peek(size_t *count)
{
    return ring_peek(&receive, count);
}

void usb_serial_drop(size_t count)
{
    ring_drop(&receive, count);
    __asm__ volatile("cpsid i" ::: "memory");
    if (has_received)
        take_received();
    __asm__ volatile("cpsie i" ::: "memory");
}

void usbctrl_handler(void)
{
    uint32_t events = USB->INTS;
    if (events & USB_INT_BUS_RESET) { // before any later byte
        USB->SIE_STATUS = USB_SIE_STATUS_BUS_RESET;
        USB->ADDR_ENDP[0] = 0;
        usb_control_reset(&control);
    }
    if (events & USB_INT_BUFF_STATUS) {
        uint32_t done = USB->BUFF_STATUS;
        USB->BUFF_STATUS = done;
        if (done & 1U)
            usb_control_sent(&control);
        if (done & 2U)
            usb_control_received(&control);
        if (control.configured && done & 1U << 2 * USB_BULK) {
            is_sending = false;
            send_next();
        }
        if (control.configured && done & 2U << 2 * USB_BULK)
            take_received();
    }
    if (events & USB_INT_SETUP_REQ) {
        USB->SIE_STATUS = USB_SIE_STATUS_SETUP_REC;
        usb_control_setup(&control);
    }
    if (events & USB_INT_DEV_SOF) {
        (void)USB->SOF_RD; // ends this interrupt
        frame_began_us = TIMERAWL;
        if (control.configured)
            send_next();
    }
}
