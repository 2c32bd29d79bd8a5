/* Calls an example's wait_for_next_period() (EXAMPLE: its file) half a second late. Prints how many of twenty waits leave a time that was
 * more than one period over before the wait began: the next waits would then end at once. */
#define main example_main
#include EXAMPLE
#undef main

int main(void)
{
    struct timespec at, before;
    int overdue = 0;
    clock_gettime(CLOCK_MONOTONIC, &at);
    nanosleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    for (int i = 0; i < 20; i++) {
        clock_gettime(CLOCK_MONOTONIC, &before);
        wait_for_next_period(&at);
        overdue += (before.tv_sec - at.tv_sec) * 1000000000LL + before.tv_nsec - at.tv_nsec > PERIOD_NS;
    }
    printf("%d\n", overdue);
}
