// The commands that the host build takes on its standard input, one a line.
#ifndef FMFTS_HOST_COMMANDS_H
#define FMFTS_HOST_COMMANDS_H

#include <stdbool.h>

#include "emulation.h"
#include "line.h"

struct session {
    struct emulation emulation;
    struct line line;
    uint64_t paced_ns;  // virtual time that passed tick by tick
    uint64_t jumped_ns; // virtual time that did not
    bool stepped;       // it passes by `run` alone
    bool held;          // it stands still
    char answer[24];    // of the last command, besides "ok"
    bool quit;
};

enum { TICK_NS = 1000000 };

// Lets so much virtual time pass: requests in, the core running, packets out.
void session_pass(struct session *session, uint64_t ns);

extern const char commands_help[];

// Executes one command (changed in the process). Returns what is wrong with it, NULL when it is done.
const char *commands_execute(struct session *session, char *command);

#endif
