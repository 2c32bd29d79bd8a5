/* Estimator.read of a healthy frame, step by step. */
#include <string.h>

#include "frame_step.h"

bool fmfts_enter(const fmfts_facts *facts, const fmfts_memory *memory, const fmfts_frame *frame, size_t readings_bytes,
                 fmfts_passage *passage)
{
    fmfts_field field;
    fmfts_pose pose;
    memcpy(&passage->next, memory, sizeof passage->next);
    if (!(facts->sensors[0] >= 1 && facts->sensors[0] <= FMFTS_SENSORS &&
          readings_bytes == FMFTS_READING_BYTES * (size_t)facts->sensors[0] &&
          fmfts_align(facts, &passage->next, frame, &field) &&
          fmfts_track(facts, &passage->next, &field, frame->temperature_c, &pose) &&
          fmfts_watch(facts, &passage->next, &field) &&
          fmfts_ask(facts, &passage->next, &pose, &passage->question, &passage->numbers))) {
        return false;
    }
    passage->numbers.temperature_c[0] = frame->temperature_c;
    passage->question.instant_us = field.instant_us;
    return true;
}

void fmfts_pose_of(const fmfts_passage *passage, float pose[FMFTS_POSE])
{
    for (int i = 0; i < FMFTS_POSE; i++) {
        pose[i] = (float)passage->question.pose[i];
    }
}

fmfts_contact fmfts_leave(const fmfts_facts *facts, fmfts_passage *passage, const void *response,
                          size_t response_bytes, const float *contact, const float *jacobian)
{
    fmfts_found found;
    fmfts_response table;
    fmfts_take_answer(&passage->question, contact, jacobian, &found);
    if (response && !(fmfts_view_response(response, response_bytes, &table) &&
                      fmfts_refine_answer(facts, &passage->question, &table, &found))) {
        return FMFTS_NO_NUMBER;
    }
    return fmfts_answer(facts, &passage->question, &found, &passage->numbers);
}
