// Reads the golden packets of tests/data/wire_vectors.ini, one section after another.
#ifndef FMFTS_TEST_VECTORS_H
#define FMFTS_TEST_VECTORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

enum { VECTOR_KEYS_MAX = 24, VECTOR_NUMBERS_MAX = 64 };

struct vector {
    char name[64];
    char type[16];
    uint8_t line[300];
    size_t line_count;
    int key_count;
    struct {
        char name[32];
        int64_t numbers[VECTOR_NUMBERS_MAX];
        int count;
    } keys[VECTOR_KEYS_MAX];
};

FILE *vectors_open(void);
bool vectors_next(FILE *file, struct vector *vector);

// The i-th number of a key; fails the test where the vector has none.
int64_t vector_at(const struct vector *vector, const char *key, int i);
int64_t vector_get(const struct vector *vector, const char *key);

#endif
