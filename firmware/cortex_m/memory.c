// The memory functions that compilers call on their own, with their names in C and in the ARM run-time ABI. This
// program has no C library.
#include <stdint.h>
#include <string.h>

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
    unsigned char *out = to;
    const unsigned char *in = from;
    while (count--)
        *out++ = *in++;
    return to;
}

void *memmove(void *to, const void *from, size_t count)
{
    unsigned char *out = to;
    const unsigned char *in = from;
    if (out > in)
        while (count--)
            out[count] = in[count];
    else
        while (count--)
            *out++ = *in++;
    return to;
}

void *memset(void *to, int byte, size_t count)
{
    unsigned char *out = to;
    while (count--)
        *out++ = (unsigned char)byte;
    return to;
}

int memcmp(const void *left, const void *right, size_t count)
{
    const unsigned char *a = left, *b = right;
    for (; count--; a++, b++)
        if (*a != *b)
            return *a - *b;
    return 0;
}

// The names that clang calls (ARM run-time ABI, AEABI 4.3.4). Those ending in 4 and 8 are for aligned memory.
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t count)
{
    memcpy(to, from, count);
}

void __aeabi_memmove(void *to, const void *from, size_t count)
{
    memmove(to, from, count);
}

void __aeabi_memset(void *to, size_t count, int byte)
{
    memset(to, byte, count);
}

void __aeabi_memclr(void *to, size_t count)
{
    memset(to, 0, count);
}

#define ALIAS(name, arguments) __attribute__((alias(#name))) void name##4 arguments, name##8 arguments
ALIAS(__aeabi_memcpy, (void *restrict to, const void *restrict from, size_t count));
ALIAS(__aeabi_memmove, (void *to, const void *from, size_t count));
ALIAS(__aeabi_memset, (void *to, size_t count, int byte));
ALIAS(__aeabi_memclr, (void *to, size_t count));

// Clang calls these for shifts of 64 bits. In halves, because a shift of 64 bits would call this function again.
union halves {
    uint64_t whole;
    uint32_t half[2]; // the lower half first
};

uint64_t __aeabi_llsl(uint64_t value, int count)
{
    union halves v = {value};
    if (count >= 32)
        return (union halves){.half = {0, v.half[0] << (count - 32)}}.whole;
    uint32_t carried = count ? v.half[0] >> (32 - count) : 0;
    return (union halves){.half = {v.half[0] << count, v.half[1] << count | carried}}.whole;
}

uint64_t __aeabi_llsr(uint64_t value, int count)
{
    union halves v = {value};
    if (count >= 32)
        return (union halves){.half = {v.half[1] >> (count - 32), 0}}.whole;
    uint32_t carried = count ? v.half[1] << (32 - count) : 0;
    return (union halves){.half = {v.half[0] >> count | carried, v.half[1] >> count}}.whole;
}
