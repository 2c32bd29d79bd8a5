/* Says which fingers touch a pad with several magnets, each time that another one comes or goes. */
#include <fmfts.h>
#include <stdio.h>
#include <string.h>

static void who_touches(const struct fmfts_client *client, const struct fmfts_contact *contact, char said[FMFTS_TEXT_SIZE])
{
    const char *why = NULL;
    if (!fmfts_alive(client))
        why = "nothing arrives";
    else if (!contact->more.known)
        why = "a pad with one magnet takes two fingers for one";
    else if (!fmfts_valid(client) || !contact->contacts.known)
        why = "cannot tell";
    else if (contact->more.value)
        why = "more than two fingers";
    else if (contact->contacts.count == 0)
        why = "no finger";
    snprintf(said, FMFTS_TEXT_SIZE, "%s", why ? why : "");
    for (int i = 0; !why && i < contact->contacts.count; i++) {
        size_t used = strlen(said);
        const struct fmfts_finger *finger = &contact->contacts.finger[i]; /* its place, force and shear are in it, too */
        snprintf(said + used, FMFTS_TEXT_SIZE - used, "%sfinger %lld", i ? " and " : "", (long long)finger->id);
    }
}

int main(int count, char **words)
{
    char why[FMFTS_TEXT_SIZE], said[FMFTS_TEXT_SIZE] = "", touching[FMFTS_TEXT_SIZE];
    struct fmfts_client *client = fmfts_connect(count > 1 ? words[1] : "demo", NULL, why);
    if (!client)
        return fprintf(stderr, "fingers: %s\n", why), 69;
    struct fmfts_contact contact = {0};
    while (fmfts_latest(client, &contact, FMFTS_ALIVE_MS) >= 0) {
        who_touches(client, &contact, touching);
        if (strcmp(said, touching) != 0)
            puts(touching), fflush(stdout);
        memcpy(said, touching, sizeof said);
    }
    fprintf(stderr, "fingers: %s\n", fmfts_refusal(client));
    fmfts_close(client);
    return 69;
}
