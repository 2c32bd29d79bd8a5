#include "usb_control.h"

#include <string.h>

#include "usb_registers.h"

enum {
    // bmRequestType's kind and recipient, without the direction, and bRequest
    GET_STATUS = 0,
    CLEAR_FEATURE = 1,
    SET_ADDRESS = 5,
    GET_DESCRIPTOR = 6,
    GET_CONFIGURATION = 8,
    SET_CONFIGURATION = 9,
    GET_INTERFACE = 10,
    SET_INTERFACE = 11,
    TO_HOST = 0x80,
    OF_ENDPOINT = 2,
    CLASS = 0x20,
    KIND = 0x60,
    SET_LINE_CODING = 0x20,
    GET_LINE_CODING = 0x21,
    SET_CONTROL_LINE_STATE = 0x22,
    SEND_BREAK = 0x23,
    TERMINAL_READY = 1,
};

void usb_arm(volatile uint32_t *buffer, uint32_t count, bool full, bool data1)
{
    uint32_t value = count | (full ? USB_BUFFER_FULL : 0) | (data1 ? USB_BUFFER_DATA1 : 0);
    *buffer = value;
    // [4.1.2.5.1] The controller's clock is slower: it must see all other bits before it sees that it owns the buffer.
    __asm__ volatile("nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop" ::: "memory");
    *buffer = value | USB_BUFFER_AVAILABLE;
}

void usb_control_reset(struct usb_control *control)
{
    control->configured = control->terminal_ready = control->answers = control->takes_line_coding = false;
    control->new_address = 0;
    control->open_endpoints(false);
}

static void stall(void)
{
    USB->EP_STALL_ARM = USB_EP_STALL_ARM_EP0;
    USB_MEMORY->buffer[0].in = USB_BUFFER_STALL;
    USB_MEMORY->buffer[0].out = USB_BUFFER_STALL;
}

static void send_next(struct usb_control *control)
{
    uint32_t count = control->left < USB_PACKET ? control->left : USB_PACKET;
    for (uint32_t i = 0; i < count; i++)
        USB_MEMORY->endpoint_0[i] = control->answer[i];
    control->answer += count;
    control->left = (uint16_t)(control->left - count);
    control->ends_short = control->ends_short && count == USB_PACKET;
    usb_arm(&USB_MEMORY->buffer[0].in, count, true, control->data1);
    control->data1 = !control->data1;
}

static void answer(struct usb_control *control, const void *bytes, size_t size, uint16_t asked)
{
    control->answer = bytes;
    control->left = (uint16_t)(size < asked ? size : asked);
    control->ends_short = size < asked; // the host expects more, so an empty packet must follow a full last one
    control->answers = true;
    send_next(control);
}

// An empty packet ends the host's order.
static void confirm(struct usb_control *control)
{
    control->left = 0;
    control->ends_short = false;
    send_next(control);
}

static void configure(struct usb_control *control, bool configured)
{
    control->configured = configured;
    control->terminal_ready = false;
    control->open_endpoints(configured);
}

static void order_of_class(struct usb_control *control, uint8_t request, uint16_t value, uint16_t size)
{
    switch (request) {
    case SET_LINE_CODING: // there is no line, so the rate means nothing
        if (size != sizeof control->line_coding) {
            stall();
            break;
        }
        control->takes_line_coding = true;
        usb_arm(&USB_MEMORY->buffer[0].out, USB_PACKET, false, true);
        break;
    case GET_LINE_CODING:
        answer(control, control->line_coding, sizeof control->line_coding, size);
        break;
    case SET_CONTROL_LINE_STATE: {
        bool ready = value & TERMINAL_READY;
        if (ready && !control->terminal_ready)
            control->port_opened();
        control->terminal_ready = ready && control->configured;
        confirm(control);
        break;
    }
    case SEND_BREAK:
        confirm(control);
        break;
    default:
        stall();
    }
}

static void order(struct usb_control *control, uint8_t type, uint8_t request, uint16_t value, uint16_t size)
{
    size_t found;
    const uint8_t *descriptor;
    switch (request) {
    case GET_DESCRIPTOR:
        descriptor = usb_descriptor((uint8_t)(value >> 8), (uint8_t)value, control->serial, &found);
        if (descriptor == NULL)
            stall();
        else
            answer(control, descriptor, found, size);
        break;
    case SET_ADDRESS:
        control->new_address = value & 0x7F; // valid after its confirmation
        confirm(control);
        break;
    case SET_CONFIGURATION:
        if (value > 1) {
            stall();
            break;
        }
        configure(control, value == 1);
        confirm(control);
        break;
    case GET_CONFIGURATION:
        control->small[0] = control->configured;
        answer(control, control->small, 1, size);
        break;
    case GET_STATUS:
        memset(control->small, 0, 2);
        answer(control, control->small, 2, size);
        break;
    case GET_INTERFACE:
        control->small[0] = 0;
        answer(control, control->small, 1, size);
        break;
    case CLEAR_FEATURE:
        if ((type & ~TO_HOST) == OF_ENDPOINT && control->configured)
            control->open_endpoints(true);
        confirm(control);
        break;
    case SET_INTERFACE:
        confirm(control);
        break;
    default:
        stall();
    }
}

void usb_control_setup(struct usb_control *control)
{
    uint8_t setup[8];
    for (int i = 0; i < 8; i++)
        setup[i] = USB_MEMORY->setup[i];
    uint16_t value = (uint16_t)(setup[2] | setup[3] << 8), size = (uint16_t)(setup[6] | setup[7] << 8);
    // A host that abandoned its last order leaves that order's buffers.
    USB_MEMORY->buffer[0].in = USB_MEMORY->buffer[0].out = 0;
    control->answers = control->takes_line_coding = false;
    control->new_address = 0;
    control->data1 = true;
    if ((setup[0] & KIND) == CLASS)
        order_of_class(control, setup[1], value, size);
    else if ((setup[0] & KIND) == 0)
        order(control, setup[0], setup[1], value, size);
    else
        stall();
}

void usb_control_sent(struct usb_control *control)
{
    if (control->new_address != 0) {
        USB->ADDR_ENDP[0] = control->new_address;
        control->new_address = 0;
    }
    if (!control->answers)
        return;
    if (control->left > 0 || control->ends_short) {
        send_next(control);
    } else {
        control->answers = false;
        usb_arm(&USB_MEMORY->buffer[0].out, 0, false, true);
    }
}

void usb_control_received(struct usb_control *control)
{
    if (!control->takes_line_coding)
        return;
    control->takes_line_coding = false;
    for (size_t i = 0; i < sizeof control->line_coding; i++)
        control->line_coding[i] = USB_MEMORY->endpoint_0[i];
    confirm(control);
}
