// The registers of the RP2040's USB controller as a device, by its data sheet [4.1.4].
#ifndef FMFTS_RP2040_USB_REGISTERS_H
#define FMFTS_RP2040_USB_REGISTERS_H

#include <stdint.h>

struct usb_controller {
    uint32_t ADDR_ENDP[16], MAIN_CTRL, SOF_WR, SOF_RD, SIE_CTRL, SIE_STATUS, INT_EP_CTRL, BUFF_STATUS, BUFF_CPU_SHOULD_HANDLE,
        EP_ABORT, EP_ABORT_DONE, EP_STALL_ARM, NAK_POLL, EP_STATUS_STALL_NAK, USB_MUXING, USB_PWR, unused_0[4], INTR, INTE,
        INTF, INTS;
};
#define USB ((volatile struct usb_controller *)0x50110000)
#define USBCTRL_IRQ 5
#define USB_MAIN_CTRL_CONTROLLER_EN (1U << 0)
#define USB_SIE_CTRL_PULLUP_EN (1U << 16)
#define USB_SIE_CTRL_EP0_INT_1BUF (1U << 29)
#define USB_SIE_STATUS_SUSPENDED (1U << 4)
#define USB_SIE_STATUS_SETUP_REC (1U << 17)
#define USB_SIE_STATUS_BUS_RESET (1U << 19)
#define USB_EP_STALL_ARM_EP0 3U
#define USB_MUXING_TO_PHY_SOFTCON (1U << 0 | 1U << 3)
#define USB_PWR_VBUS_TAKEN_AS_THERE (1U << 2 | 1U << 3)
#define USB_INT_BUFF_STATUS (1U << 4)
#define USB_INT_BUS_RESET (1U << 12)
#define USB_INT_SETUP_REQ (1U << 16)
#define USB_INT_DEV_SOF (1U << 17)

// [4.1.2.5] The memory that controller and program share. An endpoint names its buffers by their offset in it.
struct usb_memory {
    uint8_t setup[8];
    struct {
        uint32_t in, out;
    } control[15], buffer[16]; // of endpoints 1 to 15, and 0 to 15
    uint8_t endpoint_0[64], unused[64], notices[64], bulk_in[64], bulk_out[64];
};
#define USB_MEMORY ((volatile struct usb_memory *)0x50100000)
#define USB_CONTROL_ENABLE (1U << 31)
#define USB_CONTROL_INTERRUPT (1U << 29)
#define USB_CONTROL_BULK (2U << 26)
#define USB_CONTROL_INTERRUPT_TYPE (3U << 26)
#define USB_BUFFER_FULL (1U << 15)
#define USB_BUFFER_DATA1 (1U << 13)
#define USB_BUFFER_STALL (1U << 11)
#define USB_BUFFER_AVAILABLE (1U << 10)
#define USB_BUFFER_LENGTH 0x3FFU

#endif
