/* Closes a gripper until the pad feels limit_n. Opens it at once when the force is larger, over range, or not known.
 * It closes only after 0.2 s without a reason to open, so that a force near the limit does not make it chatter.
 * It runs as a control loop of 1 kHz and never waits for the pad. */
#define _POSIX_C_SOURCE 200809L
#include <fmfts.h>
#include <stdio.h>
#include <time.h>

static const double limit_n = 1.0;
static const double largest_force_sd_n = 0.3; /* a force with a larger deviation does not close the gripper */
enum { PERIOD_NS = 1000000, CALM_PERIODS = 200 };

/* Why the gripper must open; NULL: it may close. */
static const char *why_open(const struct fmfts_client *client, const struct fmfts_contact *contact)
{
    if (!fmfts_alive(client) || !fmfts_fresh(client))
        return "nothing arrives";
    if (contact->over_range)
        return "more than the pad can measure";
    if (contact->health != FMFTS_OK)
        return fmfts_health_name(contact->health);
    if (fmfts_measured(contact) && contact->force_n.value > limit_n)
        return "pressed hard enough";
    return fmfts_valid(client) ? NULL : "no force that is certain enough";
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
    const char *printed = ""; /* the last printed reason; NULL: the gripper may close */
    int calm = 0;             /* periods since there was a reason to open */
    enum fmfts_result result;
    struct timespec period;
    clock_gettime(CLOCK_MONOTONIC, &period);
    while ((result = fmfts_latest(client, &contact, 0)) >= 0) {
        const char *reason = why_open(client, &contact);
        calm = reason ? 0 : calm < CALM_PERIODS ? calm + 1 : calm;
        if (reason != printed && (reason || calm == CALM_PERIODS)) { /* each is a constant */
            printed = reason;
            /* Your gripper's command goes here. */
            bool explained = reason == fmfts_health_name(contact.health) && contact.reason[0];
            if (reason)
                printf("OPEN (%s%s%s)\n", reason, explained ? ": " : "", explained ? contact.reason : "");
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
