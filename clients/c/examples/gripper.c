/* Closes a gripper until the pad feels limit_n. Opens it at once when the force is larger, over range, or not known.
 * It closes only after 0.2 s without a reason to open, so that a force near the limit does not make it chatter.
 * It runs as a control loop of 1 kHz and never waits for the pad. */
#define _POSIX_C_SOURCE 200809L
#include <fmfts.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

static const double limit_n = 1.0;
static const double largest_force_sd_n = 0.5; /* a force with a larger deviation does not close the gripper */
enum { PERIOD_NS = 1000000, CALM_PERIODS = 200 };

/* Must the gripper open? `why` says why. */
static bool must_open(const struct fmfts_client *client, const struct fmfts_contact *contact, char why[FMFTS_TEXT_SIZE])
{
    bool pressed = fmfts_measured(contact) && contact->force_n.value > limit_n;
    if (!fmfts_why_invalid(client, why))
        return true;
    if (pressed)
        snprintf(why, FMFTS_TEXT_SIZE, "pressed with %.2f N", contact->force_n.value);
    return pressed;
}

/* Do they differ in more than their numbers, which change with each contact? */
static bool is_news(const char *why, const char *printed)
{
    static const char numbers[] = "0123456789.";
    for (;; why++, printed++) {
        why += strspn(why, numbers);
        printed += strspn(printed, numbers);
        if (*why != *printed || !*why)
            return *why != *printed;
    }
}

static void wait_for_next_period(struct timespec *at)
{
    at->tv_nsec += PERIOD_NS;
    if (at->tv_nsec >= 1000000000) {
        at->tv_nsec -= 1000000000;
        at->tv_sec++;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, at, NULL);
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if ((now.tv_sec - at->tv_sec) * 1000000000LL + now.tv_nsec - at->tv_nsec > PERIOD_NS)
        *at = now; /* the program was stopped: handling each missed period now would use one message several times */
}

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE];
    struct fmfts_client *client = fmfts_connect(count > 1 ? words[1] : "demo", NULL, why);
    if (!client) {
        fprintf(stderr, "gripper: %s\n", why);
        return 69;
    }
    fmfts_set_largest_force_sd(client, largest_force_sd_n);
    if (!fmfts_why(client, 1000, why)) /* before the loop, because it may take a second */
        fprintf(stderr, "gripper: %s\n", why);
    struct fmfts_contact contact = {.health = FMFTS_DISCONNECTED};
    char printed[FMFTS_TEXT_SIZE] = "-"; /* the last printed reason; "": the gripper may close */
    int calm = 0;                        /* periods since there was a reason to open */
    enum fmfts_result result;
    struct timespec period;
    clock_gettime(CLOCK_MONOTONIC, &period);
    while ((result = fmfts_latest(client, &contact, 0)) >= 0) {
        bool open = must_open(client, &contact, why);
        calm = open ? 0 : calm < CALM_PERIODS ? calm + 1 : calm;
        if (is_news(why, printed) && (open || calm == CALM_PERIODS)) {
            strcpy(printed, why);
            /* Your gripper's command goes here. */
            if (open)
                printf("OPEN (%s)\n", why);
            else
                puts("CLOSE");
            fflush(stdout);
        }
        wait_for_next_period(&period);
    }
    printf("OPEN (%s)\n", result == FMFTS_WRONG_VERSION ? fmfts_refusal(client) : "the socket is broken");
    fmfts_close(client);
    return 69;
}
