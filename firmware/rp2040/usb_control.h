// Endpoint 0: the host's questions and orders. [USB 2.0 chapter 9]
#ifndef FMFTS_RP2040_USB_CONTROL_H
#define FMFTS_RP2040_USB_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "usb_descriptors.h"

struct usb_control {
    bool configured;
    bool terminal_ready; // DTR: a program has opened the port
    char serial[USB_SERIAL_DIGITS];
    void (*open_endpoints)(bool opened); // their data start with DATA0
    void (*port_opened)(void);

    // The answer that is being sent, and the action at its end.
    const uint8_t *answer;
    uint16_t left;
    bool ends_short; // its last packet must be shorter than the others
    bool answers, takes_line_coding;
    uint8_t new_address;
    bool data1;
    uint8_t small[2], line_coding[7];
};

void usb_control_reset(struct usb_control *control);
void usb_control_setup(struct usb_control *control);     // the host has sent a setup packet
void usb_control_sent(struct usb_control *control);      // the host has taken a packet
void usb_control_received(struct usb_control *control);  // it has sent one

// Lets the host take `count` bytes of an endpoint's memory, or fill it. DATA1 or DATA0.
void usb_arm(volatile uint32_t *buffer, uint32_t count, bool full, bool data1);

#endif
