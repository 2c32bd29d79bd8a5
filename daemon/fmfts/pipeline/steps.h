/* The steps of fmfts_judge that belong to no equation: what reading.c, contact_of_pose.c and now.c add to pose/step.h and
 * contact/step.h. */
#ifndef FMFTS_STEPS_H
#define FMFTS_STEPS_H

#include "frame.h"

/* Data that one step of a frame passes to the next. touched: whether χ² of the change from rest is known; the answer is
 * in the memory. */
typedef struct {
    fmfts_step step;
    fmfts_memory *memory;
    fmfts_displacement displacement;
    bool overlaps;                     /* whether `overlap` is to be taken from the pose's covariance */
    double overlap[5][5];
    bool touch_is_known, has_estimate; /* has_estimate: of the contact model */
    double lifted_m;                   /* how far the magnet certainly is above the range of the training */
    fmfts_estimate estimate;
} fmfts_frame_work;

/* reading.c: an empty verdict. */
void fmfts_begin_step(const fmfts_parameters *parameters, fmfts_memory *memory, double temperature_c, fmfts_frame_work *work);

/* reading.c: an empty verdict and an empty reading. */
void fmfts_begin(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_frame *frame, fmfts_frame_work *work,
                 fmfts_reading *reading);

/* reading.c: notes the host's time of the sample. Without a new one the newest is still the last. */
void fmfts_date(const fmfts_frame *frame, fmfts_frame_work *work);

/* reading.c: the fields of the message. */
void fmfts_read(const fmfts_pad *pad, fmfts_frame_work *work, fmfts_reading *reading);

/* reading.c: the sensors of which every axis is used, as a mask. */
unsigned fmfts_sensors_used(const fmfts_step *step);

/* reading.c: updates the magnet's estimate for neighbours that measure it. */
void fmfts_show_others(const fmfts_pad *pad, const fmfts_frame_work *work);

/* reading.c: makes the frame degraded, with this additional reason. */
void fmfts_degrade(fmfts_verdict *verdict, const char *why);

/* contact_of_pose.c: whether the frame has a pose to make a contact of. A touch without one ends after some frames. */
bool fmfts_has_trusted_pose(fmfts_frame_work *work);

/* contact_of_pose.c: counts for how long the temperature is missing, and forgets the touch after a gap. */
void fmfts_follow_gaps(fmfts_frame_work *work);

/* contact_of_pose.c: the change of pose from rest, with its covariance, and whether it is a touch. */
void fmfts_find_change(const fmfts_pad *pad, fmfts_frame_work *work);

/* contact_of_pose.c: place and force, if there is a contact model, and whether that is a contact. False if the model gives no
 * number. */
bool fmfts_find_contact(const fmfts_pad *pad, fmfts_frame_work *work);

/* contact_of_pose.c: whether something lifts the magnet, which no press does; else, whether the touch is a contact. False if the
 * model gives no number. */
bool fmfts_doubt_contact(const fmfts_pad *pad, fmfts_frame_work *work);

/* recent_rest.c: whether the change since a moment before is a contact. False if the model gives no number. */
bool fmfts_compare_recent(const fmfts_pad *pad, fmfts_frame_work *work, bool was_contact);

/* contact_of_pose.c: the deviation of the force to publish. */
double fmfts_force_sd_n(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate,
                        const fmfts_contact_memory *touch);

/* slip.c: whether the finger slips, if slip is configured. */
void fmfts_find_slip(const fmfts_pad *pad, fmfts_frame_work *work, fmfts_reading *reading);

/* now.c: the contact at the time of publishing; only for healthy frames without neighbours and without a hand that
 * moves. False if the contact model raised. */
bool fmfts_find_now(const fmfts_pad *pad, const fmfts_frame *frame, fmfts_frame_work *work, fmfts_reading *reading);

/* Beyond it (a board that stalls, a chip that stopped) the newest sample is too old for the time of publishing. */
#define FMFTS_LONGEST_LEAD_S 0.02

/* now.c: when the message of a frame is published, on the board's clock. */
double fmfts_publish_us(const fmfts_parameters *parameters, int64_t sequence, int64_t frame_us, fmfts_now_memory *memory);

/* now.c: whether the sample is this pad's, and follows the samples of the last frame, taken_us, at a plausible
 * distance. */
bool fmfts_is_new(const fmfts_pose_parameters *parameters, const int64_t *taken_us, const fmfts_early *early);

/* now.c: the same, and whether it follows those that came before their frame. */
bool fmfts_comes_next(const fmfts_pose_parameters *parameters, const int64_t *taken_us, const fmfts_motion_memory *memory,
                   const fmfts_early *early);

#endif
