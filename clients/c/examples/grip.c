/* Holds an object between two pads with little more than the least force with which it does not slip.
 *
 *     grip left right             closes until both touch, and holds
 *     grip left right --loosen    then also looks for the least force
 *
 * The same controller as clients/python/examples/grip.py, with the same constants. It loosens the object, once, until it slips a
 * millimetre or two; the force at which that began is the least one. It then holds with `reserve` more, and with as much more as the
 * shear grows: a glass that is filled. Each further slip teaches anew. While no pad knows its force the gripper never
 * opens; while both do not, it holds still. docs/slip.md says what it needs. */
#define _POSIX_C_SOURCE 200809L
#include <fmfts.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

enum { PADS = 2, PERIOD_NS = 10000000 };
static const double period_s = PERIOD_NS * 1e-9;
static const double first_n = 0.6;         /* of a new grip, and the least of any: the pads report no slip below it */
static const double largest_n = 2.0;       /* the pads measure no more, and the object may not bear more */
static const double reserve = 0.15;        /* more than the force at which it slipped */
static const double first_reserve = 0.5;   /* while the least force is not known */
static const double still_slips_per_s = 0.6; /* if it still slips: this share more force */
static const double loosens_per_s = 0.15;  /* as a share */
static const double approach_m_per_s = 0.015, fastest_m_per_s = 0.04;
static const double stiffness_n_per_m = 200.0; /* of a finger of your gripper */
static const double close_m_per_s_per_n = 30.0 / 200.0; /* how fast to close for a newton too little: 30 / stiffness */
static const double settled_s = 0.3, smooth_s = 0.15;
static const double least_shear_n = 0.1; /* of a pad, where its growth is told from */
static const double same_s = 0.05; /* a slip that begins again within this time is the same one */
static const double moved_m = 2e-3; /* a contact that moved this far slipped, too: a slow slip comes late or never */
static const double vague = 0.4; /* a force with a deviation of a larger share is not known: the contact is near the pad's rim */
static const double least_share = 0.5; /* a pad that reads less of the force, or more than 2 - least_share of it, is wrong */
static const double late_s = 0.1;   /* an older sample does not describe the present */

enum slips { NOT_KNOWN, STICKS, SLIPS };

/* What is remembered of a pad since its last slip. shear_n: the present shear, smoothed; shear_then_n: just after the
 * slip. */
struct memory {
    bool placed, sheared, sheared_then;
    double x_m, y_m, shear_n, shear_then_n;
};

/* found: the least force is known, and the arm may hurry. hangs: in the air. slipped_n: the force at which it slipped last. growth: of
 * the shear since. force_n, closing: as of the last step, and how fast it closed then. share: of each pad's reading in the mean of both,
 * while both were known; 0 before that. */
struct grip {
    bool found, touched, slips, hangs;
    double slipped_n, sticks_s, growth, force_n, closing, share[PADS];
    struct memory pad[PADS];
};

/* For the gripper and the arm. close_m_per_s: speed of each finger; negative opens. why: a reason for people to read.
 * */
struct command {
    double close_m_per_s;
    bool may_lift;
    const char *why;
};

/* Is the pad's force known now? Slip and place may be unknown: a light touch. */
static bool is_usable(const struct fmfts_client *client, const struct fmfts_contact *contact)
{
    return fmfts_alive(client) && fmfts_sample_age_s(contact) <= late_s && contact->health == FMFTS_OK && !contact->over_range &&
           contact->contact != FMFTS_TOUCH_UNKNOWN && contact->force_n.known;
}

/* Is its force hardly known? */
static bool is_vague(const struct fmfts_contact *contact)
{
    return contact->contact == FMFTS_TOUCHED && contact->force_sd_n.known &&
           contact->force_sd_n.value > vague * fmax(contact->force_n.value, first_n);
}

/* The mean of both, as both fingers press equally and each pad errs by a factor of its own. If one falls silent, the other still tells the
 * mean, by its share. */
static double pressed_n(struct grip *grip, const struct fmfts_contact *const known[PADS])
{
    double sum_n = 0.0, alone_n = 0.0;
    int count = 0;
    for (int i = 0; i < PADS; i++) {
        if (!known[i])
            continue;
        sum_n += known[i]->force_n.value;
        alone_n += known[i]->force_n.value / (grip->share[i] > 0.0 ? grip->share[i] : 1.0);
        count++;
    }
    if (count == 0)
        return grip->force_n;
    if (count < PADS)
        return alone_n / count;
    double mean_n = sum_n / PADS;
    for (int i = 0; i < PADS; i++) {
        double now = mean_n > first_n / 2.0 ? fmin(fmax(known[i]->force_n.value / mean_n, least_share), 2.0 - least_share) : 1.0;
        double before = grip->share[i] > 0.0 ? grip->share[i] : now;
        grip->share[i] = before + fmin(period_s / smooth_s, 1.0) * (now - before);
    }
    return mean_n;
}

static enum slips is_slipping(const struct fmfts_contact *contact, struct memory *pad)
{
    if (!contact->slip.known || !contact->slip.slipping.known || !contact->x_m.known || !contact->y_m.known)
        return NOT_KNOWN;
    double x_m = contact->x_m.value, y_m = contact->y_m.value;
    if (!pad->placed)
        pad->placed = true, pad->x_m = x_m, pad->y_m = y_m;
    bool has_moved = hypot(x_m - pad->x_m, y_m - pad->y_m) > moved_m;
    return contact->slip.slipping.value || has_moved ? SLIPS : STICKS;
}

/* By what factor the shear of both pads grew since the last slip: they carry the object together, and what one reads too much the other
 * may read too little. Shear is what the margin leaves of the friction. A pad that joins later counts from there on. While one says
 * nothing, the load has not become smaller. */
static double grown(struct grip *grip, const struct fmfts_contact *const seen[PADS])
{
    double now_n = 0.0, then_n = 0.0, least = 1.0;
    bool joined[PADS] = {false};
    int counted = 0;
    for (int i = 0; i < PADS; i++) {
        const struct fmfts_slip *slip = seen[i] ? &seen[i]->slip : NULL;
        struct memory *pad = &grip->pad[i];
        if (slip && slip->known && slip->friction.known && slip->margin_n.known) {
            double shear_n = slip->friction.value * seen[i]->force_n.value - slip->margin_n.value;
            pad->shear_n = pad->sheared ? pad->shear_n + fmin(period_s / smooth_s, 1.0) * (shear_n - pad->shear_n) : shear_n;
            pad->sheared = true;
            joined[i] = grip->sticks_s >= settled_s;
        } else if (!pad->sheared_then) {
            pad->sheared = false; /* it is too old by then */
        }
        if (pad->sheared_then && joined[i])
            now_n += pad->shear_n, then_n += pad->shear_then_n, counted++;
        else if (pad->sheared_then)
            least = grip->growth;
    }
    if (counted)
        grip->growth = fmax(now_n / fmax(then_n, least_shear_n * counted), least);
    for (int i = 0; i < PADS; i++)
        if (joined[i] && !grip->pad[i].sheared_then)
            grip->pad[i].sheared_then = true, grip->pad[i].shear_then_n = grip->pad[i].shear_n / grip->growth;
    return grip->growth;
}

static double wanted_n(struct grip *grip, const struct fmfts_contact *const seen[PADS], double force_n, bool loosen)
{
    bool begins = grip->sticks_s > same_s, knows = true;
    grip->slips = false;
    for (int i = 0; i < PADS; i++) {
        enum slips slips = seen[i] ? is_slipping(seen[i], &grip->pad[i]) : NOT_KNOWN;
        grip->slips = grip->slips || slips == SLIPS;
        knows = knows && slips != NOT_KNOWN;
    }
    if (grip->slips) {
        if (loosen && !grip->found)
            grip->found = begins = true;
        grip->slipped_n = begins ? force_n : grip->slipped_n * (1.0 + still_slips_per_s * period_s);
        grip->sticks_s = 0.0;
        memset(grip->pad, 0, sizeof grip->pad);
        grip->growth = 1.0;
    } else if (loosen && !grip->found && knows) {
        grip->slipped_n *= 1.0 - loosens_per_s * period_s;
        if ((1.0 + first_reserve) * grip->slipped_n < first_n) /* the pads cannot measure a force this small */
            grip->found = true, grip->slipped_n = first_n / (1.0 + reserve);
    }
    grip->sticks_s += period_s;
    double growth = grip->found ? grown(grip, seen) : 1.0;
    double more = 1.0 + (grip->found ? reserve : first_reserve), most_n = largest_n;
    if (!grip->hangs) { /* the arm does not lift while a pad is beyond its range */
        most_n /= fmax(1.0, fmax(grip->share[0], grip->share[1]));
        grip->slipped_n = fmin(grip->slipped_n, most_n / more);
    }
    return fmin(fmax(more * grip->slipped_n * growth, first_n), most_n);
}

/* seen: the newest contact of each pad; NULL if it cannot be used. loosen: find the least force; the arm stands still
 * and the object hangs in the air. */
static struct command step(struct grip *grip, const struct fmfts_contact *const seen[PADS], bool loosen)
{
    int count = 0, touched = 0, known_count = 0;
    const struct fmfts_contact *known[PADS];
    double closing = grip->closing;
    for (int i = 0; i < PADS; i++) {
        known[i] = seen[i] && !is_vague(seen[i]) ? seen[i] : NULL;
        count += seen[i] != NULL;
        known_count += known[i] != NULL;
        touched += seen[i] && seen[i]->contact == FMFTS_TOUCHED;
    }
    grip->hangs = grip->hangs || loosen;
    grip->closing = 0.0;
    if (count == 0)
        return (struct command){.why = "no pad knows its force"};
    if (!grip->touched && touched < count)
        return (struct command){.close_m_per_s = count == PADS ? approach_m_per_s : 0.0};
    grip->touched = true;
    grip->force_n += stiffness_n_per_m * closing * period_s; /* all that is known if both pads say nothing */
    double force_n = grip->force_n = pressed_n(grip, known);
    double wanted = wanted_n(grip, seen, force_n, loosen && known_count == PADS);
    double speed = fmin(fmax(close_m_per_s_per_n * (wanted - force_n), -fastest_m_per_s), fastest_m_per_s);
    if (known_count < PADS) /* the other pad alone may tighten, but only while it touches the object */
        speed = touched > 0 ? fmax(speed, 0.0) : 0.0;
    grip->closing = speed;
    if (known_count < PADS)
        return (struct command){.close_m_per_s = speed, .why = "a pad does not know its force"};
    return (struct command){.close_m_per_s = speed, .may_lift = !grip->slips && force_n > 0.9 * wanted};
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

static int end(struct fmfts_client *client[PADS], const char *why)
{
    puts("hold (it ends)"), fflush(stdout); /* set your gripper's speed to 0; otherwise it keeps the last one */
    fprintf(stderr, "grip: %s\n", why);
    for (int i = 0; i < PADS; i++)
        fmfts_close(client[i]);
    return 69;
}

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE], saying[FMFTS_TEXT_SIZE], said[FMFTS_TEXT_SIZE] = "";
    bool loosen = count > 1 && strcmp(words[count - 1], "--loosen") == 0;
    const char *names[PADS] = {"left", "right"};
    int named = count - 1 - loosen;
    struct fmfts_client *client[PADS];
    struct fmfts_contact contact[PADS] = {0};
    struct grip grip = {.slipped_n = first_n / (1.0 + first_reserve), .sticks_s = 1.0, .growth = 1.0};
    struct timespec period;
    if (named != 0 && named != PADS)
        return fprintf(stderr, "grip: It needs two pads, and got %d. Name both: grip left right [--loosen]\n", named), 64;
    for (int i = 0; i < PADS; i++) {
        client[i] = fmfts_connect(named == PADS ? words[1 + i] : names[i], NULL, why);
        if (!client[i])
            return fprintf(stderr, "grip: %s\n", why), 69;
        if (!fmfts_why(client[i], 1000, why)) /* before the loop, because it may take a second */
            fprintf(stderr, "grip: %s\n", why);
    }
    clock_gettime(CLOCK_MONOTONIC, &period);
    for (;;) {
        const struct fmfts_contact *seen[PADS];
        for (int i = 0; i < PADS; i++) {
            enum fmfts_result result = fmfts_latest(client[i], &contact[i], 0);
            if (result < 0)
                return end(client, result == FMFTS_WRONG_VERSION ? fmfts_refusal(client[i]) : "the socket is broken");
            seen[i] = is_usable(client[i], &contact[i]) ? &contact[i] : NULL;
        }
        struct command command = step(&grip, seen, loosen);
        /* Your gripper's and arm's commands go here. */
        const char *what = command.close_m_per_s > 1e-3 ? "close" : command.close_m_per_s < -1e-3 ? "open" : "hold";
        snprintf(saying, sizeof saying, "%s%s%s%s%s", what, command.may_lift ? ", lift" : "", command.why ? " (" : "",
                 command.why ? command.why : "", command.why ? ")" : "");
        if (strcmp(saying, said) != 0)
            puts(saying), fflush(stdout);
        memcpy(said, saying, sizeof said);
        wait_for_next_period(&period);
    }
}
