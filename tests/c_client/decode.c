/* Messages on standard input, each after its length (32 bits, little-endian); for each a line of JSON. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shown.h"

int main(void)
{
    uint8_t head[4];
    while (fread(head, 1, sizeof head, stdin) == sizeof head) {
        size_t size = (size_t)head[0] | (size_t)head[1] << 8 | (size_t)head[2] << 16;
        uint8_t *body = malloc(size); /* as long as the message, so that the sanitizer sees the next byte */
        if (fread(body, 1, size, stdin) != size)
            return 1;
        struct fmfts_contact contact, untouched;
        memset(&contact, 0xA5, sizeof contact);
        memcpy(&untouched, &contact, sizeof contact);
        char why[FMFTS_TEXT_SIZE];
        enum fmfts_result result = fmfts_decode(body, size, &contact, why);
        printf("{\"result\": %d, ", (int)result);
        if (result == FMFTS_NEW)
            show_contact(&contact);
        else if (memcmp(&contact, &untouched, sizeof contact) != 0)
            abort();
        show_text("why", why);
        printf("\"size\": %zu}\n", size);
        fflush(stdout);
        free(body);
    }
    return 0;
}
