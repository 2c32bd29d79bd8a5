#include "matrix.h"

#include <math.h>
#include <string.h>

#include "wide.h"

enum { MOST_SWEEPS = 60 };
static const double ORTHOGONAL = 1e-15, ROUNDING = 0x1p-52;

FMFTS_WIDE void fmfts_product(size_t m, size_t k, size_t n, const double *a, const double *b, double *out)
{
    for (size_t i = 0; i < m; i++, a += k, out += n) {
        size_t j = 0;
        for (; j + FMFTS_LANES <= n; j += FMFTS_LANES) {
            fmfts_four sum = {0.0}, four;
            for (size_t l = 0; l < k; l++) {
                memcpy(&four, b + l * n + j, sizeof four);
                sum += a[l] * four;
            }
            memcpy(out + j, &sum, sizeof sum);
        }
        for (; j < n; j++) {
            double sum = 0.0;
            for (size_t l = 0; l < k; l++) {
                sum += a[l] * b[l * n + j];
            }
            out[j] = sum;
        }
    }
}

/* Each finished column is subtracted from all that are left: the order of each sum is that of its own column, and the sums of
 * a row do not wait for each other. The row above the diagonal holds the column, so that both are contiguous. */
FMFTS_WIDE bool fmfts_cholesky(size_t n, double *a)
{
    for (size_t k = 0; k < n; k++) {
        double pivot = a[k * n + k], *column = a + k * n;
        if (!(pivot > 0.0 && pivot < INFINITY)) {
            return false;
        }
        double root = sqrt(pivot);
        column[k] = root;
        for (size_t i = k + 1; i < n; i++) {
            column[i] = a[i * n + k] /= root;
        }
        for (size_t i = k + 1; i < n; i++) {
            double *restrict row = a + i * n;
            for (size_t j = k + 1; j <= i; j++) {
                row[j] -= column[i] * column[j];
            }
        }
        for (size_t i = k + 1; i < n; i++) {
            column[i] = 0.0;
        }
    }
    return true;
}

/* As fmfts_solve_lower, of `few` columns from x on; inlined for each number that is asked for. */
static inline void solve_few(size_t n, size_t columns, size_t few, const double *l, double *x)
{
    for (size_t k = 0; k < n; k++) {
        double own[FMFTS_LANES];
        for (size_t c = 0; c < few; c++) {
            own[c] = x[k * columns + c] /= l[k * n + k];
        }
        for (size_t i = k + 1; i < n; i++) {
            for (size_t c = 0; c < few; c++) {
                x[i * columns + c] -= l[i * n + k] * own[c];
            }
        }
    }
}

FMFTS_WIDE void fmfts_solve_lower(size_t n, size_t columns, const double *l, double *x)
{
    for (size_t c = 0; c < columns; c += FMFTS_LANES) {
        if (columns - c >= FMFTS_LANES) {
            solve_few(n, columns, FMFTS_LANES, l, x + c);
        } else if (columns - c == 3) {
            solve_few(n, columns, 3, l, x + c);
        } else if (columns - c == 2) {
            solve_few(n, columns, 2, l, x + c);
        } else {
            solve_few(n, columns, 1, l, x + c);
        }
    }
}

void fmfts_solve_lower_transposed(size_t n, size_t columns, const double *l, double *x)
{
    for (size_t k = n; k-- > 0;) {
        for (size_t c = 0; c < columns; c++) {
            x[k * columns + c] /= l[k * n + k];
        }
        for (size_t i = 0; i < k; i++) {
            for (size_t c = 0; c < columns; c++) {
                x[i * columns + c] -= l[k * n + i] * x[k * columns + c];
            }
        }
    }
}

static double along(size_t count, size_t stride, const double *a, const double *b)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += a[i * stride] * b[i * stride];
    }
    return sum;
}

/* The squares of two columns, and their product. */
typedef struct {
    double first, second, common;
} squares;

/* What `along` says of two columns, in turns: three sums do not wait for each other. */
static squares along_both(size_t count, size_t stride, const double *a, const double *b)
{
    double first = 0.0, second = 0.0, common = 0.0;
    for (size_t i = 0; i < count; i++) {
        double one = a[i * stride], other = b[i * stride];
        first += one * one;
        second += other * other;
        common += one * other;
    }
    return (squares){first, second, common};
}

static void rotate(size_t count, size_t stride, double *left, double *right, double cosine, double sine)
{
    for (size_t i = 0; i < count; i++) {
        double one = left[i * stride], other = right[i * stride];
        left[i * stride] = cosine * one - sine * other;
        right[i * stride] = sine * one + cosine * other;
    }
}

bool fmfts_rotate_columns(size_t m, size_t n, double *a, double *v)
{
    for (size_t i = 0; i < n * n; i++) {
        v[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    }
    /* A column with a smaller square is only the rounding of other columns: rotating it would never converge. */
    double least = ROUNDING * (double)(m > n ? m : n), floor = least * least * along(m * n, 1, a, a);
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        bool rotated = false;
        for (size_t p = 0; p + 1 < n; p++) {
            for (size_t q = p + 1; q < n; q++) {
                squares of = along_both(m, n, a + p, a + q);
                bool rounding = of.first <= floor || of.second <= floor;
                if (rounding || !(fabs(of.common) > ORTHOGONAL * sqrt(of.first) * sqrt(of.second))) {
                    continue;
                }
                double zeta = (of.second - of.first) / (2.0 * of.common);
                double tangent = (zeta >= 0.0 ? 1.0 : -1.0) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                double cosine = 1.0 / sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
                rotate(m, n, a + p, a + q, cosine, sine);
                rotate(n, n, v + p, v + q, cosine, sine);
                rotated = true;
            }
        }
        if (!rotated) {
            return true;
        }
    }
    return false;
}

/* A reflection: v [rows], with a fixed number of doubles from one to the next. */
typedef struct {
    size_t rows, stride;
    const double *v;
    double scale;
} mirror;

/* column −= v·(v·column)·scale, of a matrix of so many columns. */
static void reflect(const mirror *m, size_t columns, double *column)
{
    double share = 0.0;
    for (size_t i = 0; i < m->rows; i++) {
        share += m->v[i * m->stride] * column[i * columns];
    }
    share *= m->scale;
    for (size_t i = 0; i < m->rows; i++) {
        column[i * columns] -= share * m->v[i * m->stride];
    }
}

void fmfts_complement(size_t m, size_t n, double *a, double *scale, double *complement)
{
    size_t left = m - n;
    for (size_t k = 0; k < n; k++) {
        double length = sqrt(along(m - k, n, a + k * n + k, a + k * n + k));
        a[k * n + k] += a[k * n + k] >= 0.0 ? length : -length;
        double square = along(m - k, n, a + k * n + k, a + k * n + k);
        scale[k] = square > 0.0 ? 2.0 / square : 0.0;
        for (size_t j = k + 1; j < n; j++) {
            reflect(&(mirror){m - k, n, a + k * n + k, scale[k]}, n, a + k * n + j);
        }
    }
    for (size_t i = 0; i < m * left; i++) {
        complement[i] = i / left == n + i % left ? 1.0 : 0.0;
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t j = 0; j < left; j++) {
            reflect(&(mirror){m - k, n, a + k * n + k, scale[k]}, left, complement + k * left + j);
        }
    }
}
