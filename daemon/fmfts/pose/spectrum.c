/* The spectrum of alternating.py, of as many frames as the memory holds: at each frequency the power of all axes is
 * added. For white noise, 2|X|²/(nσ²) is χ² with two degrees of freedom for each axis (N. R. Lomb, 1976). */
#include "spectrum.h"

#include <math.h>
#include <string.h>

enum { AXES = 3, FREQUENCIES = FMFTS_RING, SLOWEST = 6 }; /* half a resolution apart; a turning robot is slower than SLOWEST */
/* cos and sin of 2π/128: half a turn in as many steps as there are frequencies. */
static const double COSINE = 0.9987954562051724, SINE = 0.049067674327418015;
static const double MAINS_HZ[] = {50.0, 60.0, 100.0, 120.0, 150.0, 180.0};
/* How far chips' clocks deviate from the nominal rate, which shifts an aliased frequency. */
#define CLOCK_SHARE 0.03
enum { MAINS = sizeof MAINS_HZ / sizeof MAINS_HZ[0] };

/* The ring without mean and slope, oldest first; writes the variance of each axis. */
static void level(const double *ring_t, double level_t[FMFTS_RING][AXES], double variance_t2[AXES])
{
    for (int axis = 0; axis < AXES; axis++) {
        double mean = 0.0, slope = 0.0, squares = 0.0;
        for (int i = 0; i < FMFTS_RING; i++) {
            double from_centre = i - 0.5 * (FMFTS_RING - 1);
            mean += ring_t[AXES * i + axis] / FMFTS_RING;
            slope += from_centre * ring_t[AXES * i + axis];
            squares += from_centre * from_centre;
        }
        variance_t2[axis] = 0.0;
        for (int i = 0; i < FMFTS_RING; i++) {
            level_t[i][axis] = ring_t[AXES * i + axis] - mean - slope / squares * (i - 0.5 * (FMFTS_RING - 1));
            variance_t2[axis] += level_t[i][axis] * level_t[i][axis] / FMFTS_RING;
        }
    }
}

/* |Σ x·e^{−iωt}|² of each axis. turn: cos and sin of ω from frame to frame. */
static void find_power(double level_t[FMFTS_RING][AXES], const double turn[2], double power[AXES])
{
    double cosine = 1.0, sine = 0.0, real[AXES] = {0}, imaginary[AXES] = {0};
    for (int i = 0; i < FMFTS_RING; i++) {
        for (int axis = 0; axis < AXES; axis++) {
            real[axis] += cosine * level_t[i][axis];
            imaginary[axis] += sine * level_t[i][axis];
        }
        double next = cosine * turn[0] - sine * turn[1];
        sine = sine * turn[0] + cosine * turn[1];
        cosine = next;
    }
    for (int axis = 0; axis < AXES; axis++) {
        power[axis] = real[axis] * real[axis] + imaginary[axis] * imaginary[axis];
    }
}

fmfts_line fmfts_strongest_line(const fmfts_pose_parameters *parameters, const double *ring_t)
{
    double level_t[FMFTS_RING][AXES], variance_t2[AXES], power[AXES], turn[2] = {1.0, 0.0}, most = parameters->line_chi2;
    fmfts_line line = {0.0, 0.0};
    level(ring_t, level_t, variance_t2);
    for (int k = 1; k <= FREQUENCIES; k++) {
        const double before[2] = {turn[0], turn[1]};
        turn[0] = before[0] * COSINE - before[1] * SINE;
        turn[1] = before[1] * COSINE + before[0] * SINE;
        double chi2 = 0.0, amplitude2 = 0.0;
        find_power(level_t, turn, power);
        for (int axis = 0; axis < AXES; axis++) {
            chi2 += variance_t2[axis] > 0.0 ? 2.0 * power[axis] / (FMFTS_RING * variance_t2[axis]) : 0.0;
            amplitude2 += 4.0 * power[axis] / (FMFTS_RING * FMFTS_RING);
        }
        if (k >= SLOWEST && chi2 > most) {
            most = chi2;
            line.hz = 1e6 / parameters->period_us * k / (2.0 * FREQUENCIES);
            line.amplitude_t = sqrt(amplitude2);
        }
    }
    return line;
}

void fmfts_say_line(const fmfts_pose_parameters *parameters, const fmfts_line *line, fmfts_text *text)
{
    double rate_hz = 1e6 / parameters->period_us, resolution_hz = rate_hz / FMFTS_RING;
    const char *before = "";
    fmfts_say(text, "a field of at least %.1f µT alternates at ", line->amplitude_t * 1e6);
    for (int i = 0; i < MAINS; i++) {
        double as_sampled = fabs(MAINS_HZ[i] - rate_hz * rint(MAINS_HZ[i] / rate_hz));
        double unsure_hz = resolution_hz + CLOCK_SHARE * rate_hz * rint(MAINS_HZ[i] / rate_hz);
        if (fabs(as_sampled - line->hz) < unsure_hz) {
            fmfts_say(text, "%s%.0f", before, MAINS_HZ[i]);
            before = " or ";
        }
    }
    if (*before) {
        fmfts_say(text, " Hz, as of mains (seen at %.0f Hz by frames at %.0f Hz)", line->hz, rate_hz);
    } else {
        fmfts_say(text, "%.0f Hz, or at one that frames at %.0f Hz see so", line->hz, rate_hz);
    }
}
