/* A struct that Python sees, too: its fields are named once, in a list of ONE(type, name) and MANY(type, name, count). The
 * types are double and int64_t, and uint8_t for eight at a time. record.py makes a NumPy record from FMFTS_NAMES. */
#ifndef FMFTS_FIELDS_H
#define FMFTS_FIELDS_H

#include <stddef.h>
#include <stdint.h>

#define FMFTS_ONE(type, name) type name;
#define FMFTS_MANY(type, name, count) type name[count];
#define FMFTS_STRUCT(name, FIELDS)                                                                                     \
    typedef struct {                                                                                                   \
        FIELDS(FMFTS_ONE, FMFTS_MANY)                                                                                  \
    } name;

/* A field of a struct: its type as NumPy names it, and the length of its array; 0: a single value. */
typedef struct {
    const char *name, *type;
    size_t count;
} fmfts_field_name;

#define FMFTS_TYPE_OF(type) _Generic((type)0, double: "<f8", int64_t: "<i8", uint8_t: "|u1")
#define FMFTS_ONE_NAMED(type, name) {#name, FMFTS_TYPE_OF(type), 0},
#define FMFTS_MANY_NAMED(type, name, count) {#name, FMFTS_TYPE_OF(type), count},
/* All fields of a struct in order. All take eight bytes, or a multiple of that, so there is no padding. */
#define FMFTS_NAMES(FIELDS) {FIELDS(FMFTS_ONE_NAMED, FMFTS_MANY_NAMED)}

#endif
