#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "harness.h"

enum { TESTS_MAX = 400 };

static struct {
    const char *name;
    void (*run)(void);
} tests[TESTS_MAX];
static int test_count;
static jmp_buf failed;
static char reason[500];

const char *harness_vectors;

void harness_add(const char *name, void (*run)(void))
{
    tests[test_count].name = name;
    tests[test_count++].run = run;
}

void harness_fail(const char *file, int line, const char *format, ...)
{
    int used = snprintf(reason, sizeof reason, "%s:%d: ", file, line);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(reason + used, sizeof reason - (size_t)used, format, arguments);
    va_end(arguments);
    longjmp(failed, 1);
}

static volatile int failures;

// usage: test-core VECTORS [part of a test's name]
int main(int count, char **words)
{
    if (count < 2) {
        fprintf(stderr, "usage: %s wire_vectors.ini [part of a test's name]\n", words[0]);
        return 2;
    }
    harness_vectors = words[1];
    for (volatile int i = 0; i < test_count; i++) {
        if (count > 2 && !strstr(tests[i].name, words[2]))
            continue;
        bool good = setjmp(failed) == 0;
        if (good)
            tests[i].run();
        else
            failures++;
        printf("%s %s%s%s\n", good ? "ok  " : "FAIL", tests[i].name, good ? "" : ": ", good ? "" : reason);
        fflush(stdout);
    }
    printf("%d tests, %d failed\n", test_count, failures);
    return failures != 0;
}
