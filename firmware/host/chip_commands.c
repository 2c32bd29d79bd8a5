#include "chip_commands.h"

#include <string.h>

// The fields of the pad's chips, from word `first` on.
static const char *read_field(double field_ut[PAD_SENSORS_MAX][3], int chips, const struct words *words, int first)
{
    if (words->count != first + 3 * chips)
        return "three numbers for each of the pad's sensors are due";
    for (int i = 0; i < 3 * chips; i++)
        if (!number(words->word[first + i], -1e5, 1e5, &field_ut[i / 3][i % 3]))
            return wrong_number;
    return NULL;
}

static const char *lead(struct session *session, struct place place, double field_ut[PAD_SENSORS_MAX][3], double ms)
{
    for (int i = 0; i < session->emulation.chip_count[place.pad]; i++)
        emulated_chip_glide(&session->emulation.chips[place.pad][i], field_ut[i], (uint64_t)(ms * 1e6));
    return NULL;
}

const char *execute_field(struct session *session, const struct words *words, struct place place)
{
    double field_ut[PAD_SENSORS_MAX][3];
    const char *wrong = read_field(field_ut, session->emulation.chip_count[place.pad], words, 2);
    return wrong ? wrong : lead(session, place, field_ut, 0);
}

const char *execute_glide(struct session *session, const struct words *words, struct place place)
{
    double field_ut[PAD_SENSORS_MAX][3], ms;
    const char *wrong = read_field(field_ut, session->emulation.chip_count[place.pad], words, 3);
    if (wrong || !number(words->word[2], 0, 1e6, &ms))
        return wrong ? wrong : wrong_number;
    return lead(session, place, field_ut, ms);
}

const char *execute_temperature(struct session *session, const struct words *words, struct place place)
{
    double celsius;
    if (!number(words->word[2], -100, 200, &celsius))
        return wrong_number;
    for (int i = 0; i < session->emulation.chip_count[place.pad]; i++)
        session->emulation.chips[place.pad][i].temperature_c = celsius;
    return NULL;
}

const char *execute_noise(struct session *session, const struct words *words, struct place place)
{
    double microtesla;
    if (!number(words->word[2], 0, 1e4, &microtesla))
        return wrong_number;
    for (int i = 0; i < session->emulation.chip_count[place.pad]; i++)
        session->emulation.chips[place.pad][i].noise_ut = microtesla;
    return NULL;
}

const char *execute_ppm(struct session *session, const struct words *words, struct place place)
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

const char *execute_fault(struct session *session, const struct words *words, struct place place)
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
        // Replaces the chip: the new one also comes up without a configuration, so the core sets it up.
        bench_plug_chip(chip, false);
        bench_plug_chip(chip, true);
        chip->identification[2] = '4';
    } else
        return "fault is none, unplugged, wrong-id, stuck, saturate-x, saturate-y, saturate-z or config-corrupt";
    return NULL;
}

const char *execute_mux(struct session *session, const struct words *words, struct place place)
{
    bool unplugged = strcmp(words->word[2], "unplugged") == 0;
    if (!unplugged && strcmp(words->word[2], "none") != 0)
        return "mux is none or unplugged";
    bench_plug_switch(session->emulation.switches[place.pad], !unplugged);
    return NULL;
}

const char *execute_load(struct session *session, const struct words *words, struct place place)
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
