#include "usb_descriptors.h"

#include <string.h>

enum {
    DEVICE = 1,
    CONFIGURATION = 2,
    STRING = 3,
    INTERFACE = 4,
    ENDPOINT = 5,
    OF_CLASS = 0x24,
    COMMUNICATION = 2,
    ABSTRACT_CONTROL = 2,
    DATA = 10,
    IN = 0x80,
    CONFIGURATION_SIZE = 67,
};
enum { LANGUAGES, MANUFACTURER, PRODUCT, SERIAL, STRINGS };

#define LOW_HIGH(value) (value) & 0xFF, (value) >> 8

// Vendor and product are those that Raspberry Pi gives to programs for its boards that show a serial port.
static const uint8_t device[] = {
    18, DEVICE, LOW_HIGH(0x0200), COMMUNICATION, 0, 0, USB_PACKET, LOW_HIGH(0x2E8A), LOW_HIGH(0x000A), LOW_HIGH(0x0100),
    MANUFACTURER, PRODUCT, SERIAL, 1,
};

static const uint8_t configuration[] = {
    9, CONFIGURATION, LOW_HIGH(CONFIGURATION_SIZE), 2, 1, 0, 0x80, 100 / 2, // from the bus, 100 mA
    // [CDC 1.2, PSTN 1.2] The port's control: line coding and DTR. Its notices are never sent.
    9, INTERFACE, 0, 0, 1, COMMUNICATION, ABSTRACT_CONTROL, 0, 0,
    5, OF_CLASS, 0, LOW_HIGH(0x0110), // header
    5, OF_CLASS, 1, 0, 1,             // no call management
    4, OF_CLASS, 2, 2,                // line coding and control line state
    5, OF_CLASS, 6, 0, 1,             // interfaces 0 and 1 belong together
    7, ENDPOINT, IN | USB_NOTICES, 3, LOW_HIGH(8), 255,
    9, INTERFACE, 1, 0, 2, DATA, 0, 0, 0,
    7, ENDPOINT, USB_BULK, 2, LOW_HIGH(USB_PACKET), 0,
    7, ENDPOINT, IN | USB_BULK, 2, LOW_HIGH(USB_PACKET), 0,
};
_Static_assert(sizeof configuration == CONFIGURATION_SIZE, "the configuration says how long it is");

static const uint8_t english[] = {4, STRING, LOW_HIGH(0x0409)};

const uint8_t *usb_descriptor(uint8_t type, uint8_t number, const char serial[USB_SERIAL_DIGITS], size_t *size)
{
    static uint8_t written[2 + 2 * USB_SERIAL_DIGITS];
    static const char *const texts[STRINGS] = {[MANUFACTURER] = "fmfts", [PRODUCT] = "fmfts board"};
    if (type == DEVICE && number == 0) {
        *size = sizeof device;
        return device;
    }
    if (type == CONFIGURATION && number == 0) {
        *size = sizeof configuration;
        return configuration;
    }
    if (type != STRING || number >= STRINGS)
        return NULL;
    if (number == LANGUAGES) {
        *size = sizeof english;
        return english;
    }
    const char *text = number == SERIAL ? serial : texts[number];
    size_t length = 0;
    while (length < USB_SERIAL_DIGITS && text[length] != '\0') {
        written[2 + 2 * length] = (uint8_t)text[length];
        written[3 + 2 * length] = 0;
        length++;
    }
    *size = 2 + 2 * length;
    written[0] = (uint8_t)*size;
    written[1] = STRING;
    return written;
}
