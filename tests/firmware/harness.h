// A test is a function that registers itself; a check that fails ends it and says where.
#ifndef FMFTS_TEST_HARNESS_H
#define FMFTS_TEST_HARNESS_H

#include <stdbool.h>

void harness_add(const char *name, void (*run)(void));
_Noreturn void harness_fail(const char *file, int line, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

extern const char *harness_vectors; // path of wire_vectors.ini

#define TEST(name)                                                                                                     \
    static void name(void);                                                                                            \
    __attribute__((constructor)) static void register_##name(void)                                                     \
    {                                                                                                                  \
        harness_add(#name, name);                                                                                      \
    }                                                                                                                  \
    static void name(void)

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition))                                                                                              \
            harness_fail(__FILE__, __LINE__, "not so: %s", #condition);                                                \
    } while (0)

#define CHECK_EQUAL(actual, expected)                                                                                  \
    do {                                                                                                               \
        long long actual_value = (long long)(actual), expected_value = (long long)(expected);                          \
        if (actual_value != expected_value)                                                                            \
            harness_fail(__FILE__, __LINE__, "%s is %lld, not %s = %lld", #actual, actual_value, #expected,            \
                         expected_value);                                                                              \
    } while (0)

#define CHECK_BETWEEN(actual, low, high)                                                                               \
    do {                                                                                                               \
        double actual_number = (double)(actual);                                                                       \
        if (!(actual_number >= (double)(low) && actual_number <= (double)(high)))                                      \
            harness_fail(__FILE__, __LINE__, "%s is %g, not within %g … %g", #actual, actual_number, (double)(low),    \
                         (double)(high));                                                                              \
    } while (0)

#endif
