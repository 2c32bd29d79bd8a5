#include "text.h"

#include <stdarg.h>
#include <stdio.h>

void fmfts_clear(fmfts_text *text)
{
    text->size = 0;
    text->text[0] = 0;
}

/* The size without an incomplete last character of UTF-8. */
static size_t whole_characters(const char *text, size_t size)
{
    size_t first = size;
    while (first > 0 && (text[first - 1] & 0xC0) == 0x80) {
        first--;
    }
    unsigned char lead = first > 0 ? (unsigned char)text[first - 1] : 0;
    size_t bytes = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC0 ? 2 : 1;
    return size - first + 1 < bytes ? first - 1 : size;
}

void fmfts_say(fmfts_text *text, const char *format, ...)
{
    va_list values;
    size_t room = FMFTS_TEXT_ROOM - text->size;
    va_start(values, format);
    int wanted = vsnprintf(text->text + text->size, room, format, values);
    va_end(values);
    if (wanted > 0) {
        text->size = (size_t)wanted < room ? text->size + (size_t)wanted : whole_characters(text->text, FMFTS_TEXT_ROOM - 1);
    }
    text->text[text->size] = 0;
}
