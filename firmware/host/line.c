#define _GNU_SOURCE
#include "line.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

// Waits up to two seconds until the kernel hands the bytes over. READABLE_MOST: the kernel's buffer holds 4095 bytes,
// and stays full while nobody reads.
enum { ARRIVAL_US = 20, ARRIVAL_TRIES = 100000, READABLE_MOST = 4000 };

int line_open(struct line *line)
{
    struct termios settings;
    *line = (struct line){.master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)};
    ring_init(&line->ring, line->bytes, sizeof line->bytes);
    if (line->master < 0 || grantpt(line->master) < 0 || unlockpt(line->master) < 0)
        return -1;
    if (ptsname_r(line->master, line->path, sizeof line->path) != 0 || tcgetattr(line->master, &settings) < 0)
        return -1;
    cfmakeraw(&settings);
    if (tcsetattr(line->master, TCSANOW, &settings) < 0)
        return -1;
    // Linux reports a hang-up on the master only after the other side was opened once.
    int slave = open(line->path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    return slave < 0 ? -1 : close(slave);
}

bool line_send(void *context, const uint8_t *bytes, size_t count)
{
    struct line *line = context;
    if (!line->open)
        return false;
    if (line->cut_next) {
        line->cut_next = false;
        count /= 2;
    }
    return ring_put(&line->ring, bytes, count);
}

static void hang_up(struct line *line)
{
    line->open = false;
    ring_init(&line->ring, line->bytes, sizeof line->bytes);
    tcflush(line->master, TCIOFLUSH); // the next process that opens the pty must not read bytes for this one
}

void line_flush(struct line *line)
{
    struct pollfd master = {.fd = line->master};
    size_t count;
    bool open = poll(&master, 1, 0) == 0 || !(master.revents & POLLHUP);
    if (line->open && !open)
        hang_up(line);
    line->open = open;
    while (open) {
        const uint8_t *bytes = ring_peek(&line->ring, &count);
        ssize_t written = count ? write(line->master, bytes, count) : 0;
        if (written <= 0)
            return;
        line->sent += (size_t)written;
        ring_drop(&line->ring, (size_t)written);
    }
}

static size_t readable(int slave)
{
    int count = 0;
    return ioctl(slave, FIONREAD, &count) < 0 ? 0 : (size_t)count;
}

static bool arrived(size_t count, size_t due)
{
    return count >= due || count >= READABLE_MOST;
}

void line_flush_during(struct line *line, void (*pass)(void *context), void *context)
{
    line_flush(line); // notices a hang-up before this process opens the other side itself
    int slave = line->open ? open(line->path, O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC) : -1;
    size_t due = slave < 0 ? 0 : readable(slave) - line->sent;
    pass(context);
    for (int i = 0; slave >= 0 && i < ARRIVAL_TRIES && !arrived(readable(slave), due + line->sent); i++)
        usleep(ARRIVAL_US);
    if (slave >= 0)
        close(slave);
}

size_t line_receive(struct line *line, uint8_t *bytes, size_t count)
{
    ssize_t received = line->open ? read(line->master, bytes, count) : 0;
    return received > 0 ? (size_t)received : 0;
}
