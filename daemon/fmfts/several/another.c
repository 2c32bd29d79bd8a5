/* One more finger at each place of the grid, beside the given ones: Scan.another explains it. */
#include "../arithmetic/matrix.h"
#include "fit.h"

/* What a small move of the other fingers explains. slope [used][unknowns], across [unknowns][used]: white. root: of their
 * normal matrix. */
typedef struct {
    size_t used, unknowns;
    const double *slope, *across, *root;
} others;

/* moved [unknowns][columns]: the move of the others that explains x [used][columns] best. x: receives what is left. */
static void explain(const others *o, size_t columns, double *x, double *moved)
{
    fmfts_product(o->unknowns, o->used, columns, o->across, x, moved);
    fmfts_solve_lower(o->unknowns, columns, o->root, moved);
    fmfts_solve_lower_transposed(o->unknowns, columns, o->root, moved);
    for (size_t i = 0; i < o->used; i++) {
        double explained[FMFTS_PANEL] = {0.0};
        for (size_t k = 0; k < o->unknowns; k++) {
            for (size_t j = 0; j < columns; j++) {
                explained[j] += o->slope[o->unknowns * i + k] * moved[columns * k + j];
            }
        }
        for (size_t j = 0; j < columns; j++) {
            x[columns * i + j] -= explained[j];
        }
    }
}

/* For the places of one panel: along, size: the product of a template's residual with the field's residual, and with
 * itself. */
static void measure(size_t used, const double *left, const double *field, double along[FMFTS_PANEL], double size[FMFTS_PANEL])
{
    for (size_t j = 0; j < FMFTS_PANEL; j++) {
        along[j] = size[j] = 0.0;
    }
    for (size_t i = 0; i < used; i++) {
        for (size_t j = 0; j < FMFTS_PANEL; j++) {
            double one = left[FMFTS_PANEL * i + j];
            along[j] += one * field[i];
            size[j] += one * one;
        }
    }
}

/* The white slopes of the others and their transpose, what they leave of the field, and the root of their normal matrix. */
static bool begin(const fmfts_grid *grid, const fmfts_others *told, double *across, double *normal, fmfts_refusal *refusal)
{
    fmfts_several_work *work = grid->work;
    size_t used = work->used, unknowns = told->unknowns;
    for (size_t i = 0; i < used; i++) {
        size_t value = work->index[i];
        work->white[i] = grid->measured->field_t[value] - told->predicted_t[value];
        for (size_t k = 0; k < unknowns; k++) {
            work->slope[unknowns * i + k] = told->slope[unknowns * value + k];
        }
    }
    fmfts_solve_lower(used, 1, grid->root, work->white);
    fmfts_solve_lower(used, unknowns, grid->root, work->slope);
    for (size_t i = 0; i < used; i++) {
        for (size_t k = 0; k < unknowns; k++) {
            across[used * k + i] = work->slope[unknowns * i + k];
        }
    }
    fmfts_product(unknowns, used, unknowns, across, work->slope, normal);
    for (size_t k = 0; k < unknowns; k++) {
        normal[(unknowns + 1) * k] += grid->search->head->least;
    }
    return fmfts_factored(unknowns, normal, refusal);
}

fmfts_refusal fmfts_another(const fmfts_grid *grid, const fmfts_others *told, double *found)
{
    double across[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_VALUES], normal[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS];
    double moved[FMFTS_SEVERAL_UNKNOWNS * FMFTS_PANEL], along[FMFTS_PANEL], size[FMFTS_PANEL];
    fmfts_refusal refusal = {FMFTS_FINE, 0};
    if (!fmfts_white_templates(grid)) {
        return (fmfts_refusal){FMFTS_NOT_FINITE, 0};
    }
    if (!begin(grid, told, across, normal, &refusal)) {
        return refusal;
    }
    fmfts_several_work *work = grid->work;
    const others o = {work->used, told->unknowns, work->slope, across, normal};
    size_t places = grid->search->places;
    explain(&o, 1, work->white, moved);
    for (size_t panel = 0; panel < grid->search->panels; panel++) {
        double *left = grid->room + panel * o.used * FMFTS_PANEL;
        explain(&o, FMFTS_PANEL, left, moved);
        measure(o.used, left, work->white, along, size);
        for (size_t j = 0, place = FMFTS_PANEL * panel; j < FMFTS_PANEL && place < places; j++, place++) {
            double whole = size[j] > 0.0 ? size[j] : 1.0;
            found[place] = along[j] > 0.0 ? along[j] * along[j] / whole : 0.0;
            found[places + place] = along[j] / whole;
            for (size_t k = 0; k < o.unknowns; k++) {
                found[(2 + k) * places + place] = moved[FMFTS_PANEL * k + j];
            }
        }
    }
    return refusal;
}
