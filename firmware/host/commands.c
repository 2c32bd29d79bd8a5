#include "commands.h"

#include <stdio.h>
#include <string.h>

#include "chip_commands.h"

const char commands_help[] =
    "Commands on standard input, one a line; each is answered by `ok` or `error: …`. PAD (its mux) and SENSOR\n"
    "(its channel) count from 0.\n"
    "  field PAD b1x b1y b1z … b4x b4y b4z   field at the four (--array: eight) sensors, microtesla, sensor axes; holds until changed\n"
    "  glide PAD MS b1x …                    the same, reached evenly within so many milliseconds of the board's time\n"
    "  temperature PAD CELSIUS\n"
    "  noise PAD MICROTESLA                  standard deviation per axis (0.2 at start)\n"
    "  ppm PAD SENSOR PPM                    how much faster than nominal this chip's clock runs\n"
    "  fault PAD SENSOR none|unplugged|wrong-id|stuck|saturate-x|saturate-y|saturate-z|config-corrupt\n"
    "  mux PAD none|unplugged\n"
    "  load none|COUNTS                      unplug the load cell, or set what it reads from now on\n"
    "  garbage N SEED                        N pseudo-random bytes into the stream, between packets\n"
    "  truncate                              the next packet loses its second half, closing zero included\n"
    "  reset                                 restart the core as a software reset does\n"
    "  reset-pin                             the same by the reset pin: the board finds its pads anew\n"
    "  frames PAD                            `ok N`: frames made of this pad, those before a reset included\n"
    "  hold on|off                           stop the board's time; after `off` it catches up\n"
    "  time US                               jump the board's time forward\n"
    "  run US                                let the board's time pass (only with --stepped)\n"
    "  quit\n";

static const char wrong_pad[] = "no such pad: they count from 0";
static const char wrong_sensor[] = "no such sensor: they count from 0";

static const char *garbage(struct session *session, const struct words *words, struct place place)
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

static const char *cut(struct session *session, const struct words *words, struct place place)
{
    (void)words, (void)place;
    session->line.cut_next = true;
    return NULL;
}

static const char *reset(struct session *session, const struct words *words, struct place place)
{
    (void)words, (void)place;
    emulation_reset(&session->emulation);
    return NULL;
}

static const char *reset_by_pin(struct session *session, const struct words *words, struct place place)
{
    (void)words, (void)place;
    emulation_reset_by_pin(&session->emulation);
    return NULL;
}

static const char *frames(struct session *session, const struct words *words, struct place place)
{
    (void)words;
    const struct emulation *emulation = &session->emulation;
    uint64_t made = emulation->frames_before_reset[place.pad] + emulation->device.sampler.pads[place.pad].sequence;
    snprintf(session->answer, sizeof session->answer, " %llu", (unsigned long long)made);
    return NULL;
}

static const char *hold(struct session *session, const struct words *words, struct place place)
{
    (void)place;
    bool on = strcmp(words->word[1], "on") == 0;
    if (!on && strcmp(words->word[1], "off") != 0)
        return "hold is on or off";
    session->held = on;
    return NULL;
}

static const char *jump(struct session *session, const struct words *words, struct place place)
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

static const char *run(struct session *session, const struct words *words, struct place place)
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

static const char *quit(struct session *session, const struct words *words, struct place place)
{
    (void)words, (void)place;
    session->quit = true;
    return NULL;
}

static const struct command {
    const char *name;
    int words; // 0: the line has a pad, and it counts the others itself
    bool has_pad, has_sensor;
    execute *execute;
} commands[] = {
    {"field", 0, true, false, execute_field},
    {"glide", 0, true, false, execute_glide},
    {"temperature", 3, true, false, execute_temperature},
    {"noise", 3, true, false, execute_noise},
    {"ppm", 4, true, true, execute_ppm},
    {"fault", 4, true, true, execute_fault},
    {"mux", 3, true, false, execute_mux},
    {"load", 2, false, false, execute_load},
    {"garbage", 3, false, false, garbage},
    {"truncate", 1, false, false, cut},
    {"reset", 1, false, false, reset},
    {"reset-pin", 1, false, false, reset_by_pin},
    {"frames", 2, true, false, frames},
    {"hold", 2, false, false, hold},
    {"time", 2, false, false, jump},
    {"run", 2, false, false, run},
    {"quit", 1, false, false, quit},
};

const char *commands_execute(struct session *session, char *line)
{
    struct words words = words_of(line);
    struct place place = {0, 0};
    session->answer[0] = '\0';
    for (size_t i = 0; i < sizeof commands / sizeof *commands && words.count > 0; i++) {
        const struct command *command = &commands[i];
        if (strcmp(words.word[0], command->name) != 0)
            continue;
        if (command->words ? words.count != command->words : words.count < 2)
            return "wrong number of words for this command: see --help";
        if (command->has_pad && (place.pad = small_index(words.word[1], session->emulation.switch_count)) < 0)
            return wrong_pad;
        if (command->has_sensor &&
            (place.sensor = small_index(words.word[2], session->emulation.chip_count[place.pad])) < 0)
            return wrong_sensor;
        emulation_settle(&session->emulation);
        return command->execute(session, &words, place);
    }
    return "unknown command: see --help";
}
