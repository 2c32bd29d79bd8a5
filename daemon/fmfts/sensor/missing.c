#include "missing.h"

static void say_axes(unsigned axes, fmfts_text *text)
{
    const char *before = "";
    for (int axis = 0; axis < 3; axis++) {
        if (axes >> axis & 1) {
            fmfts_say(text, "%s%c", before, "xyz"[axis]);
            before = " and ";
        }
    }
}

bool fmfts_is_missing(const fmfts_missing *missing, int sensor)
{
    return missing->silent[sensor] || missing->saturated[sensor] || missing->untellable[sensor] || missing->stuck[sensor];
}

bool fmfts_say_missing(const fmfts_missing *missing, int sensor, fmfts_text *text)
{
    if (missing->silent[sensor]) {
        fmfts_say(text, "silent");
    } else if (missing->saturated[sensor]) {
        fmfts_say(text, "saturated on ");
        say_axes(missing->saturated[sensor], text);
        fmfts_say(text, "%s", missing->words->saturated[missing->gain_code]);
    } else if (missing->untellable[sensor]) {
        fmfts_say(text, "telling on ");
        say_axes(missing->untellable[sensor], text);
        fmfts_say(text, "%s", missing->words->untellable);
    } else if (missing->stuck[sensor]) {
        fmfts_say(text, "stuck on ");
        say_axes(missing->stuck[sensor], text);
        fmfts_say(text, ", which repeats one value (run selftest)");
    }
    return fmfts_is_missing(missing, sensor);
}
