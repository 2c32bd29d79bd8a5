/* The steps of every frame of a pad, from counts to its message, in order. Each comment names the file of its step.
 * fmfts_memory is what the next frame needs; fmfts_reading is the result. */
#include "steps.h"

static bool judge(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_frame *frame, fmfts_reading *reading)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_frame_work work;
    fmfts_step *step = &work.step;
    fmfts_begin(pad, memory, frame, &work, reading);         /* reading.c */
    fmfts_align(step, frame);                                /* pose/alignment.c: samples to one instant; what is missing, stuck */
    fmfts_date(frame, &work);                                /* reading.c: when the sample was taken */
    if (parameters->message.has_baseline != 0.0) {
        fmfts_subtract(step);                                /* pose/alignment.c: baseline, deviations */
        fmfts_feel(step, pad->neighbour, (double)memory->message.sampled_ns); /* pose/neighbour.c: magnets of other pads */
        fmfts_take_posture(step, &pad->hand, (double)memory->message.sampled_ns); /* pose/posture.c: the hand's own steel and motors */
        fmfts_track(step);                                   /* pose/tracker.c: pose; pose/fault_search.c: a faulty sensor */
        fmfts_watch_residuals(step);                         /* pose/residual_monitor.c: small faults that last */
        fmfts_doubt_beside_steel(step);                      /* pose/tracker.c */
        fmfts_watch_ambient(step);                           /* pose/ambient_motion.c: a robot that turns */
        fmfts_watch_alternation(step);                       /* pose/alternating.c: mains, motors, noise that grew */
        fmfts_follow_foreign(step);                          /* pose/hidden_gradient.c: a tool that no residual shows */
        fmfts_doubt_posture(step);                           /* pose/posture.c */
        if (fmfts_has_trusted_pose(&work)) {                 /* contact_of_pose.c, as the next four */
            fmfts_follow_gaps(&work);                        /* a temperature that is missing; a finger that may be gone */
            fmfts_find_change(pad, &work);                   /* pose/silicone.c, overlap.c, change.c: from rest; contact/touch.c */
            if (!fmfts_find_contact(pad, &work)) {           /* contact/smooth.c, estimate.c, tolerances.c, refine.c */
                return false;
            }
            if (!fmfts_doubt_contact(pad, &work)) {          /* something pulls, or the field jumped; contact/touch.c, recent_rest.c */
                return false;
            }
        }
        fmfts_find_slip(pad, &work, reading);                /* slip.c; contact/slip.c, friction.c: only where asked for */
        if (!fmfts_find_now(pad, frame, &work, reading)) {   /* now.c: the contact at the time of publishing */
            return false;
        }
    }
    fmfts_read(pad, &work, reading);                         /* reading.c: the fields of the message */
    if (!fmfts_is_finite(reading)) {
        return false;
    }
    fmfts_show_others(pad, &work);                           /* reading.c: for pads that measure this one's magnet */
    return true;
}

bool fmfts_judge(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_frame *frame, fmfts_reading *reading)
{
    const fmfts_memory before = *memory;
    bool judged = judge(pad, memory, frame, reading);
    if (!judged) {
        *memory = before; /* a frame that fails changes nothing */
    }
    return judged;
}
