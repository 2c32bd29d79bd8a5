/* A contact as a line of JSON, under the names of docs/messages.md, for tests in Python to compare. */
#ifndef SHOWN_H
#define SHOWN_H

#include "../../clients/c/fmfts.h"

void show_contact(const struct fmfts_contact *contact);
void show_text(const char *name, const char *text);

#endif
