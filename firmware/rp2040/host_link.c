#include "host_link.h"

#include "serial.h"

void host_link_start(uint32_t peripheral_hz, const uint8_t id[BOARD_ID_SIZE])
{
    serial_start(peripheral_hz);
    usb_serial_start(id);
}

bool host_link_send(void *context, const uint8_t *line, size_t count)
{
    return usb_serial_is_open() ? usb_serial_send(line, count) : serial_send(context, line, count);
}

void host_link_receive(void (*use)(const uint8_t *bytes, size_t count))
{
    size_t count;
    const uint8_t *bytes = usb_serial_peek(&count);
    use(bytes, count);
    usb_serial_drop(count);
    if (usb_serial_is_open())
        return; // two hosts at once would interrupt each other's packets
    bytes = serial_peek(&count);
    use(bytes, count);
    serial_drop(count);
}
