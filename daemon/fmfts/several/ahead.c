/* The linear field of a finger that `now` follows: pipeline/finger.c explains it.
 *
 * What is wrong of the table and of gains grows with the force; the ambient field does not. So where the finger has moved on since the
 * frame's instant, as at a tap, the field there is that of the model and what was wrong of it, in proportion to the force. */
#include "fit.h"

void fmfts_look_ahead(const fmfts_several *model, const fmfts_ahead *from, fmfts_several_work *work, double *ahead_t,
                      double *by_finger)
{
    const double force_n = from->finger[2], per_n = force_n / (force_n * force_n + from->light_n * from->light_n);
    const fmfts_predicted *there = from->there ? &work->aside : NULL;
    if (there) {
        fmfts_predict(model, (fmfts_fingers){1, from->there}, FMFTS_SLOPED, &work->aside);
    }
    for (size_t v = 0; v < model->values; v++) {
        double even_t = 0.0;
        for (size_t i = 0; i < 3; i++) {
            even_t += model->by_ambient[i * model->stride + v] * from->ambient_t[i];
        }
        double wrong_t = from->misfit_t[v] - from->noise_t[v] - even_t, wrong_t_per_n = wrong_t * per_n;
        double change_t = from->change_t[v] - from->noise_t[v];
        if (there) {
            change_t = there->field[v] + even_t + wrong_t + wrong_t_per_n * (from->there[2] - force_n);
        }
        const double *slope = (there ? there->slope : from->slope_t) + FMFTS_FINGER * v;
        ahead_t[v] = from->moment * (from->rest_t[v] + change_t);
        for (size_t i = 0; i < FMFTS_FINGER; i++) {
            by_finger[FMFTS_FINGER * v + i] = from->moment * (slope[i] + (i == 2 ? wrong_t_per_n : 0.0));
        }
    }
}
