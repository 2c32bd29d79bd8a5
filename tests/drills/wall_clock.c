// A wall clock that can be set for one process: if preloaded, CLOCK_REALTIME is shifted by the number in $WALL_CLOCK, a
// file of eight bytes (seconds). All other clocks, and waits, stay the kernel's.
//
// libfaketime 0.9.10 cannot be used with threads of CPython: under it pthread_cond_timedwait on CLOCK_MONOTONIC returns
// at once, told to leave that clock alone or not, and CPython hands its lock over by such waits. Two threads that count
// took 50 to 100 times the processor time, a line of the log 60 ms; time.sleep ended with EINVAL.
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t *offset_s;

__attribute__((constructor)) static void attach(void)
{
    int file = open(getenv("WALL_CLOCK"), O_RDONLY | O_CLOEXEC);
    void *shared = mmap(NULL, sizeof *offset_s, PROT_READ, MAP_SHARED, file, 0);
    if (file < 0 || shared == MAP_FAILED)
        abort();
    close(file);
    offset_s = shared;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    if (syscall(SYS_clock_gettime, clock, now) != 0)
        return -1;
    if ((clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) && offset_s)
        now->tv_sec += *offset_s;
    return 0;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    (void)zone;
    struct timespec exact;
    int result = clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return result;
}

time_t time(time_t *also)
{
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (also)
        *also = exact.tv_sec;
    return exact.tv_sec;
}
