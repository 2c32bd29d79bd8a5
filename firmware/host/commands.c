#define _GNU_SOURCE
#include "commands.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../core/hmc5983.h"

const char commands_help[] =
    "Commands on standard input, one a line; each is answered by `ok` or `error: …`. PAD and SENSOR count from 0.\n"
    "  field PAD b1x b1y b1z … b4x b4y b4z   field at the sensors, microtesla, sensor axes; holds until changed\n"
    "  temperature PAD CELSIUS\n"
    "  noise PAD MICROTESLA                  standard deviation per axis (0.2 at start)\n"
    "  ppm PAD SENSOR PPM                    how much faster than nominal this chip's clock runs\n"
    "  fault PAD SENSOR none|unplugged|wrong-id|stuck|saturate-x|saturate-y|saturate-z|config-corrupt\n"
    "  mux PAD none|unplugged\n"
    "  load none|COUNTS                      unplug the load cell, or what it reads from now on\n"
    "  garbage N SEED                        N pseudo-random bytes into the stream, between packets\n"
    "  truncate                              the next packet loses its second half, closing zero included\n"
    "  reset                                 restart the core as a software reset does\n"
    "  frames PAD                            `ok N`: frames made of this pad, those before a reset included\n"
    "  hold on|off                           the board's time stands still, and catches up afterwards\n"
    "  time US                               jump the board's time forward\n"
    "  run US                                with --stepped: let so much time pass\n"
    "  quit\n";

enum { WORDS_MAX = 16, NUMBERS_MAX = 3 * SAMPLER_SENSORS_MAX };

static const char wrong_pad[] = "no such pad: they count from 0";
static const char wrong_sensor[] = "no such sensor: they count from 0";
static const char wrong_number[] = "not a finite number within range";

struct words {
    char *word[WORDS_MAX];
    int count;
};

static struct words split(char *command)
{
    struct words words = {.count = 0};
    char *rest = NULL;
    for (char *word = strtok_r(command, " \t\r", &rest); word && words.count < WORDS_MAX;
         word = strtok_r(NULL, " \t\r", &rest))
        words.word[words.count++] = word;
    return words;
}

static bool number(const char *word, double low, double high, double *value)
{
    char *end;
    *value = strtod(word, &end);
    return end != word && *end == '\0' && *value >= low && *value <= high;
}

static int small_index(const char *word, int count)
{
    double value;
    return number(word, 0, count - 1, &value) && value == floor(value) ? (int)value : -1;
}

struct place {
    int pad;
    int sensor;
};

static const char *field(struct session *session, struct words *words, struct place place)
{
    double values[NUMBERS_MAX];
    for (int i = 0; i < NUMBERS_MAX; i++)
        if (!number(words->word[2 + i], -1e5, 1e5, &values[i]))
            return wrong_number;
    for (int i = 0; i < NUMBERS_MAX; i++)
        session->emulation.chips[place.pad][i / 3].field_ut[i % 3] = values[i];
    return NULL;
}

static const char *temperature(struct session *session, struct words *words, struct place place)
{
    double celsius;
    if (!number(words->word[2], -100, 200, &celsius))
        return wrong_number;
    for (int i = 0; i < SAMPLER_SENSORS_MAX; i++)
        session->emulation.chips[place.pad][i].temperature_c = celsius;
    return NULL;
}

static const char *noise(struct session *session, struct words *words, struct place place)
{
    double microtesla;
    if (!number(words->word[2], 0, 1e4, &microtesla))
        return wrong_number;
    for (int i = 0; i < SAMPLER_SENSORS_MAX; i++)
        session->emulation.chips[place.pad][i].noise_ut = microtesla;
    return NULL;
}

static const char *ppm(struct session *session, struct words *words, struct place place)
{
    double value;
    if (!number(words->word[3], -1e5, 1e5, &value))
        return wrong_number;
    session->emulation.chips[place.pad][place.sensor].ppm = value;
    return NULL;
}

static void mend(struct emulated_chip *chip)
{
    bench_plug_chip(chip, true);
    chip->identification[2] = '3';
    chip->clock_stopped = false;
    chip->saturated_axes = 0;
}

static const char *fault(struct session *session, struct words *words, struct place place)
{
    struct emulated_chip *chip = &session->emulation.chips[place.pad][place.sensor];
    const char *kind = words->word[3];
    if (strcmp(kind, "none") == 0)
        mend(chip);
    else if (strcmp(kind, "unplugged") == 0)
        bench_plug_chip(chip, false);
    else if (strcmp(kind, "stuck") == 0)
        chip->clock_stopped = true;
    else if (strlen(kind) == 10 && strncmp(kind, "saturate-", 9) == 0 && kind[9] >= 'x' && kind[9] <= 'z')
        chip->saturated_axes |= (uint8_t)(1 << (kind[9] - 'x'));
    else if (strcmp(kind, "config-corrupt") == 0)
        chip->config_b ^= 0x60; // another gain, at once
    else if (strcmp(kind, "wrong-id") == 0) {
        // Another chip in its place: it also comes up without a configuration, so the core looks at it again.
        bench_plug_chip(chip, false);
        bench_plug_chip(chip, true);
        chip->identification[2] = '4';
    } else
        return "fault is none, unplugged, wrong-id, stuck, saturate-x, saturate-y, saturate-z or config-corrupt";
    return NULL;
}

static const char *mux(struct session *session, struct words *words, struct place place)
{
    bool unplugged = strcmp(words->word[2], "unplugged") == 0;
    if (!unplugged && strcmp(words->word[2], "none") != 0)
        return "mux is none or unplugged";
    bench_plug_switch(session->emulation.switches[place.pad], !unplugged);
    return NULL;
}

static const char *load(struct session *session, struct words *words, struct place place)
{
    (void)place;
    struct emulated_converter *converter = &session->emulation.converter;
    double counts = 0;
    converter->present = strcmp(words->word[1], "none") != 0;
    if (converter->present && !number(words->word[1], -8388608, 8388607, &counts))
        return wrong_number;
    converter->counts = (int32_t)counts;
    return NULL;
}

static const char *garbage(struct session *session, struct words *words, struct place place)
{
    (void)place;
    double count, seed;
    if (!number(words->word[1], 0, sizeof session->line.bytes, &count) || !number(words->word[2], 0, 4294967295.0, &seed))
        return wrong_number;
    uint8_t bytes[sizeof session->line.bytes];
    uint32_t random = (uint32_t)seed * 2654435761U + 1U;
    for (int i = 0; i < (int)count; i++) {
        random ^= random << 13;
        random ^= random >> 17;
        random ^= random << 5;
        bytes[i] = (uint8_t)(random >> 16);
    }
    if (!session->line.open)
        return "nobody has opened the pty";
    return ring_put(&session->line.ring, bytes, (size_t)count) ? NULL : "the line has no room for so many bytes now";
}

static const char *cut(struct session *session, struct words *words, struct place place)
{
    (void)words, (void)place;
    session->line.cut_next = true;
    return NULL;
}

static const char *reset(struct session *session, struct words *words, struct place place)
{
    (void)words, (void)place;
    emulation_reset(&session->emulation);
    return NULL;
}

static const char *frames(struct session *session, struct words *words, struct place place)
{
    (void)words;
    const struct emulation *emulation = &session->emulation;
    uint64_t made = emulation->frames_before_reset[place.pad] + emulation->device.sampler.pads[place.pad].sequence;
    snprintf(session->answer, sizeof session->answer, " %llu", (unsigned long long)made);
    return NULL;
}

static const char *hold(struct session *session, struct words *words, struct place place)
{
    (void)place;
    bool on = strcmp(words->word[1], "on") == 0;
    if (!on && strcmp(words->word[1], "off") != 0)
        return "hold is on or off";
    session->held = on;
    return NULL;
}

static const char *jump(struct session *session, struct words *words, struct place place)
{
    (void)place;
    double us;
    if (!number(words->word[1], 0, 1e12, &us))
        return wrong_number;
    emulation_jump(&session->emulation, (uint64_t)us);
    session->jumped_ns += (uint64_t)us * 1000;
    return NULL;
}

void session_pass(struct session *session, uint64_t ns)
{
    uint8_t request[256];
    size_t count;
    while ((count = line_receive(&session->line, request, sizeof request)) > 0)
        device_receive(&session->emulation.device, request, count);
    session->paced_ns += ns;
    emulation_run_until(&session->emulation, session->paced_ns + session->jumped_ns);
    line_flush(&session->line);
}

struct span {
    struct session *session;
    uint64_t left_ns;
};

static void pass_span(void *context)
{
    struct span *span = context;
    while (span->left_ns > 0) {
        uint64_t tick_ns = span->left_ns < TICK_NS ? span->left_ns : TICK_NS;
        session_pass(span->session, tick_ns);
        span->left_ns -= tick_ns;
    }
}

static const char *run(struct session *session, struct words *words, struct place place)
{
    (void)place;
    double us;
    if (!session->stepped)
        return "time passes by itself: start with --stepped";
    if (!number(words->word[1], 0, 1e9, &us))
        return wrong_number;
    struct span span = {session, (uint64_t)us * 1000};
    line_flush_during(&session->line, pass_span, &span);
    return NULL;
}

static const char *quit(struct session *session, struct words *words, struct place place)
{
    (void)words, (void)place;
    session->quit = true;
    return NULL;
}

static const struct command {
    const char *name;
    int words;
    bool has_pad, has_sensor;
    const char *(*execute)(struct session *session, struct words *words, struct place place);
} commands[] = {
    {"field", 2 + NUMBERS_MAX, true, false, field},
    {"temperature", 3, true, false, temperature},
    {"noise", 3, true, false, noise},
    {"ppm", 4, true, true, ppm},
    {"fault", 4, true, true, fault},
    {"mux", 3, true, false, mux},
    {"load", 2, false, false, load},
    {"garbage", 3, false, false, garbage},
    {"truncate", 1, false, false, cut},
    {"reset", 1, false, false, reset},
    {"frames", 2, true, false, frames},
    {"hold", 2, false, false, hold},
    {"time", 2, false, false, jump},
    {"run", 2, false, false, run},
    {"quit", 1, false, false, quit},
};

const char *commands_execute(struct session *session, char *line)
{
    struct words words = split(line);
    struct place place = {0, 0};
    session->answer[0] = '\0';
    for (size_t i = 0; i < sizeof commands / sizeof *commands && words.count > 0; i++) {
        const struct command *command = &commands[i];
        if (strcmp(words.word[0], command->name) != 0)
            continue;
        if (words.count != command->words)
            return "wrong number of words for this command: see --help";
        if (command->has_pad && (place.pad = small_index(words.word[1], session->emulation.board.pad_count)) < 0)
            return wrong_pad;
        if (command->has_sensor && (place.sensor = small_index(words.word[2], SAMPLER_SENSORS_MAX)) < 0)
            return wrong_sensor;
        emulation_settle(&session->emulation);
        return command->execute(session, &words, place);
    }
    return "unknown command: see --help";
}
