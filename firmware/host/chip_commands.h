// The commands about chips, their surroundings and faults. Each returns an error sentence, or NULL when it is done.
#ifndef FMFTS_HOST_CHIP_COMMANDS_H
#define FMFTS_HOST_CHIP_COMMANDS_H

#include "commands.h"
#include "words.h"

struct place {
    int pad;
    int sensor;
};

typedef const char *execute(struct session *session, const struct words *words, struct place place);

execute execute_field, execute_glide, execute_temperature, execute_noise, execute_ppm, execute_fault, execute_mux, execute_load;

#endif
