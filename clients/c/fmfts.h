/* Contacts from fmfts-daemon for a controller: where a soft tactile pad is touched, and how hard.
 *
 * SI units, the unit in every name; "_sd_" is one standard deviation of the value before it. Pad axes: origin in the
 * sensor plane, z toward the finger. docs/messages.md of the daemon explains every field. MIT licence.
 */
#ifndef FMFTS_H
#define FMFTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FMFTS_SCHEMA_VERSION = 1,
    FMFTS_ALIVE_MS = 300, /* three missing messages: the daemon sends 10 or more a second even without hardware */
    FMFTS_WORD_SIZE = 65, /* size of names and hashes, with the closing zero; longer ones are refused */
    FMFTS_MAX_FINGERS = 4, /* places for fingers; further fingers are dropped */
    FMFTS_MAX_MAGNETS = 9, /* places for poses of a pad with several magnets; further poses are dropped */
    FMFTS_TEXT_SIZE = 256 /* size of sentences, with the closing zero; longer ones are cut */
};

enum fmfts_result {
    FMFTS_NEW = 1,            /* a contact that was not handed out before */
    FMFTS_NOTHING = 0,        /* nothing new arrived in time: not the same as "no contact" */
    FMFTS_REFUSED = -1,       /* only from fmfts_decode(): a message that must not be used; fmfts_latest() drops it */
    FMFTS_WRONG_VERSION = -2, /* the daemon sends another schema version: waiting does not help */
    FMFTS_FAILED = -3         /* the socket is broken */
};

/* Zero never means "ok", so that a struct of zeros is not taken for a good contact. */
enum fmfts_health {
    FMFTS_HEALTH_UNKNOWN = 0, /* a newer daemon sent a word that this client does not know */
    FMFTS_OK,
    FMFTS_DEGRADED,     /* a sensor or an axis is excluded; deviations are larger */
    FMFTS_DISTURBED,    /* a field that no pose explains: steel, a foreign magnet */
    FMFTS_LOST,         /* no pose fits */
    FMFTS_STALE,        /* the source is connected and silent */
    FMFTS_DISCONNECTED, /* the source is not connected */
    FMFTS_NO_BASELINE   /* nothing was subtracted, so nothing can be estimated */
};

enum fmfts_touch { FMFTS_TOUCH_UNKNOWN = 0, FMFTS_UNTOUCHED, FMFTS_TOUCHED };

/* A value that the daemon may not know. If `known` is false, `value` is NaN; else it is finite. */
struct fmfts_number {
    bool known;
    double value;
};

struct fmfts_vector {
    bool known;
    double value[3];
};

struct fmfts_word {
    bool known;
    char value[FMFTS_WORD_SIZE];
};

struct fmfts_flag {
    bool known;
    bool value;
};

/* Pose of a magnet. Use it only if `known` is true. */
struct fmfts_pose {
    bool known;
    double position_m[3];
    double position_sd_m[3];
    double axis[3]; /* unit vector along the magnet's moment */
    double axis_sd_rad;
    double remanence_t;
    double remanence_sd_t;
    struct fmfts_vector ambient_t;
    struct fmfts_vector ambient_sd_t;
    double residual_t;
    double chi2;
};

/* One finger on a pad with several magnets. */
struct fmfts_finger {
    int64_t id; /* constant while the finger stays */
    double x_m, x_sd_m, y_m, y_sd_m;
    double force_n, force_sd_n;
    struct fmfts_number shear_x_n, shear_x_sd_n, shear_y_n, shear_y_sd_n;
};

/* The fingers that touch: if `known` is true, `count` of them, and 0 is no contact. Entries beyond `count` are NaN. */
struct fmfts_fingers {
    bool known;
    int count;
    struct fmfts_finger finger[FMFTS_MAX_FINGERS];
};

struct fmfts_poses {
    bool known;
    int count;
    struct fmfts_pose pose[FMFTS_MAX_MAGNETS];
};

/* The contact when its message was published, its rates of change (per second), and the deviations. Use it only if
 * `known` is true, and a place only if that is known; fmfts_at() carries it on. */
struct fmfts_now {
    bool known;
    int64_t t_ns; /* CLOCK_MONOTONIC of the daemon's machine */
    struct fmfts_number x_m, x_sd_m, x_rate_m_per_s, x_rate_sd_m_per_s;
    struct fmfts_number y_m, y_sd_m, y_rate_m_per_s, y_rate_sd_m_per_s;
    struct fmfts_number force_n, force_sd_n, force_rate_n_per_s, force_rate_sd_n_per_s;
    struct fmfts_number shear_x_n, shear_x_sd_n, shear_x_rate_n_per_s, shear_x_rate_sd_n_per_s;
    struct fmfts_number shear_y_n, shear_y_sd_n, shear_y_rate_n_per_s, shear_y_rate_sd_n_per_s;
};

/* Whether the finger slips over the silicone. Use it only if `known` is true. Speed and direction mean something while it slips;
 * friction, and margin_n, the tangential force that is left until it slips, are known after the first slip of a touch. */
struct fmfts_slip {
    bool known; /* true if the pad's configuration asks for it */
    struct fmfts_flag slipping; /* not known without a touch, nor under a touch that is too light */
    struct fmfts_number sticking_probability;
    struct fmfts_number speed_m_per_s, speed_sd_m_per_s;
    struct fmfts_number direction_rad, direction_sd_rad; /* of the finger over the silicone, from the pad's x toward y */
    struct fmfts_number friction, friction_sd;
    struct fmfts_number margin_n, margin_sd_n;
};

struct fmfts_contact {
    char pad[FMFTS_WORD_SIZE];
    char boot[FMFTS_WORD_SIZE]; /* changes when the daemon restarts; then `seq` begins again */
    int64_t seq;                /* grows by 1 each; a gap: contacts were lost, skipped for a newer one, or too old when they were judged */
    int64_t t_sample_ns;        /* CLOCK_MONOTONIC of the daemon's machine: fmfts_sample_age_s() gives the age */
    int64_t t_publish_ns;       /* on the same clock */
    int64_t utc_ns;             /* t_publish_ns as a date, since 1970 */
    struct fmfts_number temperature_c;
    enum fmfts_health health;
    char reason[FMFTS_TEXT_SIZE]; /* why health is not ok, or place and force are not known; for people */
    enum fmfts_touch contact;
    struct fmfts_number x_m, x_sd_m, y_m, y_sd_m;
    struct fmfts_number force_n, force_sd_n;
    struct fmfts_number shear_x_n, shear_x_sd_n, shear_y_n, shear_y_sd_n;
    bool over_range;                 /* pressed harder than the model's range */
    struct fmfts_number force_min_n; /* if over_range: the force is at least this */
    /* How far the magnet is from rest. Known only of a pad without a contact model, which knows no place and no force. */
    struct fmfts_number displacement_m, displacement_sd_m;
    /* Of a pad with several magnets: each finger. Not known where the daemon cannot tell, and of a pad with one magnet, which
     * takes two fingers for one. Place, force and shear above are the resultant of all fingers. */
    struct fmfts_fingers contacts;
    struct fmfts_flag more; /* two fingers do not explain the frame; known only of a pad with several magnets */
    struct fmfts_pose pose; /* not known of a pad with several magnets */
    struct fmfts_poses poses; /* of each magnet, for a pad with several magnets */
    int64_t sensors_ok; /* bit i: sensor i was used */
    char model[FMFTS_WORD_SIZE];
    struct fmfts_word baseline;
    struct fmfts_now now; /* not known from a daemon that does not send it */
    struct fmfts_slip slip;
    /* The client fills this in: by how much this machine's CLOCK_MONOTONIC is ahead of the daemon's. 0 over ipc (same
     * machine); over tcp learned from arrivals, and not known until messages have come for FMFTS_ALIVE_MS. */
    struct fmfts_number clock_ahead_s;
};

/* Most tasks stop at a force of a newton or more; this deviation is half a newton, the largest with which a controller
 * can decide. */
#define FMFTS_LARGEST_FORCE_SD_N 0.5

struct fmfts_client;

/* Listens to one pad. On failure returns NULL and writes a sentence to `why`.
 *
 * endpoint: a base, ipc:///directory or tcp://host:port; NULL: FMFTS_BUS in the environment, else the service's
 * directory, else the user's own. Over tcp the client shows the key of the file in FMFTS_KEY (docs/security.md).
 * ZeroMQ connects in the background, and again after the daemon restarts. If the daemon is not there, that is no error,
 * but fmfts_alive() is false. After this call the functions below allocate nothing in the calling thread.
 * Use a client from one thread at a time.
 */
struct fmfts_client *fmfts_connect(const char *pad, const char *endpoint, char why[FMFTS_TEXT_SIZE]);

/* NULL is allowed. */
void fmfts_close(struct fmfts_client *client);

/* Gets the newest contact that was not handed out before, and drops older ones. Writes `contact` only for FMFTS_NEW.
 *
 * Waits up to `timeout_ms`; 0 (for a control loop): does not wait; negative: waits for ever. A signal ends the wait
 * early. A contact that was sent more than FMFTS_ALIVE_MS ago does not count as new. A message that must not be used (a
 * missing key, a wrong type, a number that is not finite) is skipped and counted in fmfts_refused().
 */
enum fmfts_result fmfts_latest(struct fmfts_client *client, struct fmfts_contact *contact, int timeout_ms);

/* These refer to the messages that fmfts_latest() has received. */
bool fmfts_alive(const struct fmfts_client *client); /* did a message about the pad come in the last FMFTS_ALIVE_MS? */
bool fmfts_fresh(const struct fmfts_client *client); /* was the pad sampled in the last FMFTS_ALIVE_MS? */
bool fmfts_valid(const struct fmfts_client *client); /* alive, fresh, measured and certain: may it be acted upon now? */
uint64_t fmfts_refused(const struct fmfts_client *client);
uint64_t fmfts_restarts(const struct fmfts_client *client); /* of the daemon */
const char *fmfts_refusal(const struct fmfts_client *client); /* why the last message was refused; "" if none was */

/* Why fmfts_valid() is false, as a sentence: nothing usable arrives, or health and its reason, or how uncertain the force is. True,
 * and "" in `why`, if fmfts_valid() is true. Does not wait; if nothing arrives, fmfts_why() says more. */
bool fmfts_why_invalid(const struct fmfts_client *client, char why[FMFTS_TEXT_SIZE]);

/* May `contact` and `force_n` (and, if touched, `x_m` and `y_m`) be used as a measurement? True if health is ok, touch
 * and force are known and in range, and a touch has a place. Does not check the age. False does not mean "no force": a
 * pad without a contact model detects a touch but knows no force. */
bool fmfts_measured(const struct fmfts_contact *contact);

/* From now on fmfts_valid() is false while the force's deviation is larger than this. Choose a third of what your task can bear.
 * Before: FMFTS_LARGEST_FORCE_SD_N, or a third of the force where that is more. */
void fmfts_set_largest_force_sd(struct fmfts_client *client, double newton);

/* Seconds since the sensors were sampled; infinite while the clock of the daemon's machine is not known. For a daemon
 * on another machine the shortest delay of the network is not included. */
double fmfts_sample_age_s(const struct fmfts_contact *contact);

/* The contact carried on to `t_ns` of this machine's CLOCK_MONOTONIC: value + rate · time, deviations that grow, force not below 0.
 * Returns false, and sets `now` to not known, if the contact's `now` is not known, if the clock of the daemon's machine
 * is not known, or if `t_ns` is more than 20 ms away. Place is not known without a touch. */
bool fmfts_at(const struct fmfts_contact *contact, int64_t t_ns, struct fmfts_now *now);

/* Why nothing arrives, as a sentence with what to do: no daemon is there, it has no such pad (and which it has), it
 * speaks another schema version, or it refuses the key. True, and "" in `why`, if contacts of the pad do arrive.
 * Listens to all pads of the daemon for up to `timeout_ms` (1000 is enough), on a connection of its own, and allocates:
 * call it before a control loop, not in it. */
bool fmfts_why(const struct fmfts_client *client, int timeout_ms, char why[FMFTS_TEXT_SIZE]);

/* "ok", "degraded", …; "unknown" for any other value. */
const char *fmfts_health_name(enum fmfts_health health);

/* Decodes one message body, for programs with a socket of their own. Returns FMFTS_NEW; or FMFTS_REFUSED or
 * FMFTS_WRONG_VERSION with a sentence in `why`. Writes `contact` only for FMFTS_NEW. */
enum fmfts_result fmfts_decode(const void *body, size_t size, struct fmfts_contact *contact, char why[FMFTS_TEXT_SIZE]);

#ifdef __cplusplus
}
#endif
#endif
