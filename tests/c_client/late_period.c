/* Calls an example's wait_for_next_period() (EXAMPLE: its file) half a second late. Prints how many of the next waits end at once. */
#define main example_main
#include EXAMPLE
#undef main

int main(void)
{
    struct timespec at, before, after;
    int at_once = 0;
    clock_gettime(CLOCK_MONOTONIC, &at);
    nanosleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    for (int i = 0; i < 20; i++) {
        clock_gettime(CLOCK_MONOTONIC, &before);
        wait_for_next_period(&at);
        clock_gettime(CLOCK_MONOTONIC, &after);
        at_once += (after.tv_sec - before.tv_sec) * 1000000000LL + after.tv_nsec - before.tv_nsec < PERIOD_NS / 4;
    }
    printf("%d\n", at_once);
}
