/* A frame on its way to its message: the steps of tables.h in their order. */
#ifndef FMFTS_PASSAGE_H
#define FMFTS_PASSAGE_H

#include <stddef.h>

#include "tables.h"

typedef struct {
    fmfts_memory next; /* what the frame leaves to the one after it, if its contact is a number */
    fmfts_question question;
    fmfts_numbers numbers;
} fmfts_passage;

/* The frame as far as the question to the contact model; false where it is not healthy. */
bool fmfts_enter(const fmfts_facts *facts, const fmfts_memory *memory, const fmfts_frame *frame, size_t readings_bytes,
                 fmfts_passage *passage);

/* What the contact model is asked. */
enum { FMFTS_POSE = 6, FMFTS_ANSWERS = 3 };
void fmfts_pose_of(const fmfts_passage *passage, float pose[FMFTS_POSE]);

/* What is said of its answer, contact [3] and jacobian [3][6]. response: of a model that refines, else NULL. */
fmfts_contact fmfts_leave(const fmfts_facts *facts, fmfts_passage *passage, const void *response,
                          size_t response_bytes, const float *contact, const float *jacobian);

#endif
