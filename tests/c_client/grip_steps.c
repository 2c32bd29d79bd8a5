/* Runs the controller of examples/grip.c on messages from stdin: for each step a byte that says whether it may loosen;
 * for each pad the size of a message (0: unusable) and the message. Prints how fast to close, whether the arm may lift,
 * and whether the least force is known. */
#define main grip_main
#include "../../clients/c/examples/grip.c"
#undef main

#include <stdlib.h>

int main(void)
{
    struct grip grip = {.slipped_n = first_n / (1.0 + first_reserve), .sticks_s = 1.0, .growth = 1.0};
    static unsigned char body[65536];
    int loosen;
    while ((loosen = getchar()) != EOF) {
        struct fmfts_contact contact[PADS];
        const struct fmfts_contact *seen[PADS] = {NULL};
        char why[FMFTS_TEXT_SIZE];
        for (int i = 0; i < PADS; i++) {
            uint32_t size;
            if (fread(&size, sizeof size, 1, stdin) != 1 || fread(body, 1, size, stdin) != size)
                return EXIT_FAILURE;
            if (size && fmfts_decode(body, size, &contact[i], why) != FMFTS_NEW)
                return fprintf(stderr, "%s\n", why), EXIT_FAILURE;
            seen[i] = size ? &contact[i] : NULL;
        }
        struct command command = step(&grip, seen, loosen != 0);
        printf("%.17g %d %d\n", command.close_m_per_s, command.may_lift, grip.found);
    }
}
