/* Solves the problems in a file of doubles and writes the answers to another: the kernel by itself, on any machine.
 *
 * A problem: rows, magnets, project, then measurements, magnets, parts, start, prior mean, prior covariance, rate,
 * diffusion. An answer: status, chi2, residual, iterations, rows, unknowns, state, covariance, direction.
 */
#include <stdio.h>
#include <stdlib.h>

#include "solver.h"

enum { MAX_ROWS = 64, MAX_VALUES = FMFTS_VALUES(FMFTS_MAX_MAGNETS) };
static double measurements[MAX_ROWS * FMFTS_MEASUREMENT], magnets[FMFTS_MAX_MAGNETS * FMFTS_MAGNET];
static double start[MAX_VALUES], mean[MAX_VALUES], prior[FMFTS_MAX_COLUMNS * FMFTS_MAX_COLUMNS];
static double rate[FMFTS_MAX_COLUMNS], diffusion[FMFTS_MAX_COLUMNS], part[FMFTS_MAX_COLUMNS];
static double work[FMFTS_WORK(MAX_ROWS)], state[MAX_VALUES], covariance[FMFTS_MAX_COLUMNS * FMFTS_MAX_COLUMNS];
static double direction[FMFTS_MAX_COLUMNS];

static void take(FILE *from, double *values, size_t count)
{
    if (fread(values, sizeof(double), count, from) != count) {
        fprintf(stderr, "the problem ends early\n");
        exit(2);
    }
}

static void give(FILE *to, const double *values, size_t count)
{
    if (fwrite(values, sizeof(double), count, to) != count) {
        perror("answers");
        exit(2);
    }
}

int main(int argc, char **argv)
{
    FILE *from = argc == 3 ? fopen(argv[1], "rb") : NULL, *to = argc == 3 ? fopen(argv[2], "wb") : NULL;
    double head[3];
    if (!from || !to) {
        fprintf(stderr, "usage: %s PROBLEMS ANSWERS\n", argv[0]);
        return 2;
    }
    while (fread(head, sizeof(double), 3, from) == 3) {
        size_t rows = (size_t)head[0], count = (size_t)head[1];
        size_t values = FMFTS_VALUES(count), columns = FMFTS_COLUMNS(count);
        if (rows > MAX_ROWS || count > FMFTS_MAX_MAGNETS) {
            fprintf(stderr, "%zu rows and %zu magnets are too many\n", rows, count);
            return 2;
        }
        uint8_t parts[FMFTS_MAX_COLUMNS];
        take(from, measurements, rows * FMFTS_MEASUREMENT);
        take(from, magnets, count * FMFTS_MAGNET);
        take(from, part, columns);
        take(from, start, values);
        take(from, mean, values);
        take(from, prior, columns * columns);
        take(from, rate, columns);
        take(from, diffusion, columns);
        for (size_t i = 0; i < columns; i++) {
            parts[i] = (uint8_t)part[i];
        }
        fmfts_problem problem = {
            .measurements = measurements,
            .rows = rows,
            .magnets = magnets,
            .magnet_count = count,
            .parts = parts,
            .start = start,
            .prior_mean = mean,
            .prior_covariance = prior,
            .rate = rate,
            .diffusion = diffusion,
            .stop_chi2 = 1e-20,
            .max_iterations = 200,
            .project = head[2] != 0.0,
        };
        fmfts_summary found = fmfts_solve(&problem, work, state, covariance, direction);
        double summary[] = {found.status,       found.chi2,         found.residual_t,
                            found.iterations,   (double)found.rows, (double)found.unknowns};
        give(to, summary, 6);
        give(to, state, values);
        give(to, covariance, columns * columns);
        give(to, direction, columns);
    }
    return fclose(to) == 0 ? 0 : 2;
}
