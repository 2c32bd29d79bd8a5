#define _GNU_SOURCE
#include "words.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char wrong_number[] = "not a finite number within range";

struct words words_of(char *command)
{
    struct words words = {.count = 0};
    char *rest = NULL;
    for (char *word = strtok_r(command, " \t\r", &rest); word && words.count < WORDS_MAX;
         word = strtok_r(NULL, " \t\r", &rest))
        words.word[words.count++] = word;
    return words;
}

bool number(const char *word, double low, double high, double *value)
{
    char *end;
    *value = strtod(word, &end);
    return end != word && *end == '\0' && *value >= low && *value <= high;
}

int small_index(const char *word, int count)
{
    double value;
    return number(word, 0, count - 1, &value) && value == floor(value) ? (int)value : -1;
}
