/* allocations PAD BASE CONTACTS: what the thread of a 1 kHz loop allocates between the first contact and the last. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "../../clients/c/fmfts.h"

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);

/* libzmq's own thread allocates what it receives; this counts the caller's. */
static _Thread_local bool counting;
static _Thread_local long allocations;

void *malloc(size_t size)
{
    allocations += counting;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    allocations += counting;
    return __libc_calloc(count, size);
}

void *realloc(void *old, size_t size)
{
    allocations += counting;
    return __libc_realloc(old, size);
}

int posix_memalign(void **into, size_t alignment, size_t size)
{
    allocations += counting;
    *into = __libc_memalign(alignment, size);
    return *into ? 0 : 12;
}

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE];
    if (count != 4)
        return 2;
    struct fmfts_client *client = fmfts_connect(words[1], words[2], why);
    struct fmfts_contact contact;
    if (!client || fmfts_latest(client, &contact, 10000) != FMFTS_NEW)
        return 1;
    counting = true;
    void *volatile counted = malloc(1); /* the counter works */
    free(counted);
    int calls = 0;
    for (int left = atoi(words[3]); left > 0; calls++) {
        left -= fmfts_latest(client, &contact, calls % 2) == FMFTS_NEW;
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    counting = false;
    printf("%d %ld\n", calls, allocations);
    fmfts_close(client);
    return 0;
}
