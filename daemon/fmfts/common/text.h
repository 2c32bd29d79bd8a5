/* A sentence for a person, made piece by piece. It is cut to its size, never within a character. */
#ifndef FMFTS_TEXT_H
#define FMFTS_TEXT_H

#include <stddef.h>

enum { FMFTS_TEXT_ROOM = 2048 };

typedef struct {
    size_t size; /* without the closing zero */
    char text[FMFTS_TEXT_ROOM];
} fmfts_text;

/* Empties the text. */
void fmfts_clear(fmfts_text *text);

/* Appends as printf does. */
#ifdef __GNUC__
__attribute__((format(printf, 2, 3)))
#endif
void fmfts_say(fmfts_text *text, const char *format, ...);

#endif
