#include "vectors.h"

#include <stdlib.h>
#include <string.h>

#include "harness.h"

FILE *vectors_open(void)
{
    FILE *file = fopen(harness_vectors, "r");
    if (!file)
        harness_fail(__FILE__, __LINE__, "cannot open %s", harness_vectors);
    return file;
}

static void parse_hex(struct vector *vector, const char *text)
{
    for (vector->line_count = 0; text[0] > ' ' && text[1] > ' '; text += 2) {
        const char digits[3] = {text[0], text[1], '\0'};
        vector->line[vector->line_count++] = (uint8_t)strtoul(digits, NULL, 16);
    }
}

static void parse_numbers(struct vector *vector, const char *key, char *text)
{
    if (vector->key_count == VECTOR_KEYS_MAX)
        harness_fail(__FILE__, __LINE__, "[%s] has too many keys", vector->name);
    int k = vector->key_count++;
    snprintf(vector->keys[k].name, sizeof vector->keys[k].name, "%.31s", key);
    vector->keys[k].count = 0;
    for (char *end; vector->keys[k].count < VECTOR_NUMBERS_MAX; text = end) {
        long long value = strtoll(text, &end, 0);
        if (end == text)
            return;
        vector->keys[k].numbers[vector->keys[k].count++] = value;
    }
}

bool vectors_next(FILE *file, struct vector *vector)
{
    static char text[4000];
    memset(vector, 0, sizeof *vector);
    while (fgets(text, sizeof text, file)) {
        char *equals = strstr(text, " = ");
        if (text[0] == '[') {
            snprintf(vector->name, sizeof vector->name, "%.*s", (int)strcspn(text + 1, "]"), text + 1);
        } else if (equals && text[0] != '#') {
            *equals = '\0';
            char *value = equals + 3;
            if (strcmp(text, "type") == 0)
                snprintf(vector->type, sizeof vector->type, "%.*s", (int)strcspn(value, "\r\n"), value);
            else if (strcmp(text, "line") == 0)
                parse_hex(vector, value);
            else
                parse_numbers(vector, text, value);
        } else if (text[0] == '\n' && vector->name[0]) {
            return true;
        }
    }
    return vector->name[0] != '\0';
}

int64_t vector_at(const struct vector *vector, const char *key, int i)
{
    for (int k = 0; k < vector->key_count; k++)
        if (strcmp(vector->keys[k].name, key) == 0 && i < vector->keys[k].count)
            return vector->keys[k].numbers[i];
    harness_fail(__FILE__, __LINE__, "[%s] has no %s number %d", vector->name, key, i);
}

int64_t vector_get(const struct vector *vector, const char *key)
{
    return vector_at(vector, key, 0);
}
