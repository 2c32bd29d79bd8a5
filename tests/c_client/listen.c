/* listen PAD [BASE]: each line on standard input is a timeout in milliseconds, and answered with a line of JSON. With a
 * leading "?", the answer is that of fmfts_why(). "sNEWTON" names the largest deviation of a valid force, and has no
 * answer. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "shown.h"

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE], line[32];
    struct fmfts_client *client = fmfts_connect(words[1], count > 2 ? words[2] : NULL, why);
    if (!client) {
        printf("{");
        show_text("why", why);
        printf("\"result\": null}\n");
        return 69;
    }
    while (fgets(line, sizeof line, stdin)) {
        struct fmfts_contact contact;
        if (*line == 's') {
            fmfts_set_largest_force_sd(client, atof(line + 1));
            continue;
        }
        if (*line == '?') {
            printf("{\"arrives\": %s, ", fmfts_why(client, atoi(line + 1), why) ? "true" : "false");
            show_text("why", why);
            printf("\"result\": null}\n");
            fflush(stdout);
            continue;
        }
        enum fmfts_result result = fmfts_latest(client, &contact, atoi(line));
        printf("{\"result\": %d, ", (int)result);
        if (result == FMFTS_NEW) {
            show_contact(&contact);
            printf("\"sample_age_s\": %.9f, ", fmfts_sample_age_s(&contact));
            printf("\"clock_ahead_s\": %.9f, ", contact.clock_ahead_s.value);
        }
        printf("\"alive\": %s, ", fmfts_alive(client) ? "true" : "false");
        printf("\"fresh\": %s, ", fmfts_fresh(client) ? "true" : "false");
        printf("\"valid\": %s, ", fmfts_valid(client) ? "true" : "false");
        printf("\"says_valid\": %s, ", fmfts_why_invalid(client, why) ? "true" : "false");
        show_text("why_invalid", why);
        show_text("refusal", fmfts_refusal(client));
        printf("\"refused\": %" PRIu64 ", \"restarts\": %" PRIu64 "}\n", fmfts_refused(client), fmfts_restarts(client));
        fflush(stdout);
    }
    fmfts_close(client);
    return 0;
}
