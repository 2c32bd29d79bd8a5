// The words of a command, and the numbers in them.
#ifndef FMFTS_HOST_WORDS_H
#define FMFTS_HOST_WORDS_H

#include <stdbool.h>

enum { WORDS_MAX = 32 };

struct words {
    char *word[WORDS_MAX];
    int count;
};

extern const char wrong_number[];

// Changes the command: its words point into it.
struct words words_of(char *command);

bool number(const char *word, double low, double high, double *value);

// The word as a whole number from 0 to `count` - 1; -1 if it is none.
int small_index(const char *word, int count);

#endif
