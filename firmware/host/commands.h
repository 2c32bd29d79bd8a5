// The commands that fmfts-host reads from its standard input, one a line.
#ifndef FMFTS_HOST_COMMANDS_H
#define FMFTS_HOST_COMMANDS_H

#include <stdbool.h>

#include "emulation.h"
#include "line.h"

struct session {
    struct emulation emulation;
    struct line line;
    uint64_t paced_ns;  // virtual time that passed tick by tick
    uint64_t jumped_ns; // virtual time that the command `time` jumped over
    bool stepped;       // time passes only by the command `run`
    bool held;          // time stands still
    char answer[24];    // the answer to the last command after "ok"
    bool quit;
};

enum { TICK_NS = 1000000 };

// Lets virtual time pass: hands requests to the core, runs it, and sends its packets.
void session_pass(struct session *session, uint64_t ns);

extern const char commands_help[];

// Executes one command and changes its text. Returns an error sentence, or NULL when it is done.
const char *commands_execute(struct session *session, char *command);

#endif
