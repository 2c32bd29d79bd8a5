/* The magnets of a frame for Python: poses.py and free_poses.py call it, and make the arrays. */
#include "_arrays.h"

/* poses(model, work, unfelt, fingers, fingers_covariance, misfit, variance, foreign, used, ambient, change, position, axis,
 * pose_variance, moves, told, by_finger) */
PyObject *fmfts_py_poses(PyObject *module, PyObject *args)
{
    enum { UNFELT = FIRST, FINGERS, COVARIANCE, MISFIT, VARIANCE, FOREIGN, USED, AMBIENT, CHANGE, POSITION, AXIS,
           POSE_VARIANCE, MOVES, TOLD, BY_FINGER, ALL };
    _Static_assert((int)ALL <= (int)MOST_BUFFERS, "more arrays than one call takes");
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, CHANGE, ALL)) {
        return NULL;
    }
    if (understood(&c, FINGERS)) {
        size_t values = c.model.values, unknowns = FMFTS_FINGER * c.fingers, numbers = c.model.poses;
        size_t places = 3 * c.model.magnets, moves = 2 * numbers + unknowns + 2 * c.model.magnets;
        if (has_doubles(&c, UNFELT, FMFTS_POSE_CHANGE) && has_doubles(&c, COVARIANCE, unknowns * unknowns) &&
            has_doubles(&c, MISFIT, values) && has_doubles(&c, VARIANCE, values) && has_foreign(&c, FOREIGN) &&
            has(&c, USED, values) && has_doubles(&c, AMBIENT, 3) && has_doubles(&c, CHANGE, numbers) &&
            has_doubles(&c, POSITION, places) && has_doubles(&c, AXIS, places) &&
            has_doubles(&c, POSE_VARIANCE, numbers) && has_doubles(&c, MOVES, numbers * moves) &&
            has_doubles(&c, TOLD, numbers * used(&c, USED)) && has_doubles(&c, BY_FINGER, numbers * unknowns)) {
            fmfts_measured measured = {.variance_t2 = array(&c, VARIANCE),
                                       .used = c.buffer[USED].buf,
                                       .foreign_t2 = foreign(&c, FOREIGN),
                                       .ambient_t = array(&c, AMBIENT)};
            fmfts_fitted fitted = {fingers(&c, FINGERS), array(&c, COVARIANCE), array(&c, MISFIT)};
            fmfts_poses poses = {
                .change = array(&c, CHANGE),
                .position = array(&c, POSITION),
                .axis = array(&c, AXIS),
                .variance = array(&c, POSE_VARIANCE),
                .moves = array(&c, MOVES),
                .told = array(&c, TOLD),
                .by_finger = array(&c, BY_FINGER),
            };
            result = told(fmfts_poses_of(&c.model, array(&c, UNFELT), &fitted, &measured, c.work, &poses), 0.0);
        }
    }
    release(&c);
    return result;
}

/* free_poses(model, work, limits, start, field, variance, foreign, used, ambient, change, covariance, misfit, found_ambient,
 * by_pose, counted, position, axis) */
PyObject *fmfts_py_free_poses(PyObject *module, PyObject *args)
{
    enum { LIMITS = FIRST, START, FIELD, VARIANCE, FOREIGN, USED, AMBIENT, CHANGE, COVARIANCE, MISFIT, FOUND_AMBIENT, BY_POSE,
           COUNTED, POSITION, AXIS, ALL };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, CHANGE, ALL)) {
        return NULL;
    }
    if (has_model(&c)) {
        size_t values = c.model.values, numbers = c.model.poses, places = 3 * c.model.magnets;
        if (has_doubles(&c, LIMITS, sizeof(fmfts_free_limits) / sizeof(double)) && has_doubles(&c, START, numbers) && has_doubles(&c, FIELD, values) &&
            has_doubles(&c, VARIANCE, values) && has_foreign(&c, FOREIGN) && has(&c, USED, values) &&
            has_doubles(&c, AMBIENT, 3) && has_doubles(&c, CHANGE, numbers) &&
            has_doubles(&c, COVARIANCE, numbers * numbers) && has_doubles(&c, MISFIT, values) &&
            has_doubles(&c, FOUND_AMBIENT, 3) && has_doubles(&c, BY_POSE, values * numbers) &&
            has_doubles(&c, COUNTED, numbers) && has_doubles(&c, POSITION, places) && has_doubles(&c, AXIS, places)) {
            fmfts_measured measured = {array(&c, FIELD), array(&c, VARIANCE), c.buffer[USED].buf, foreign(&c, FOREIGN),
                                       array(&c, AMBIENT)};
            fmfts_free_poses found = {
                .change = array(&c, CHANGE),
                .covariance = array(&c, COVARIANCE),
                .misfit_t = array(&c, MISFIT),
                .ambient_t = array(&c, FOUND_AMBIENT),
                .by_pose = array(&c, BY_POSE),
                .counted = array(&c, COUNTED),
                .position = array(&c, POSITION),
                .axis = array(&c, AXIS),
            };
            fmfts_refusal refusal =
                fmfts_free_poses_of(&c.model, c.buffer[LIMITS].buf, array(&c, START), &measured, c.work, &found);
            result = told(refusal, found.chi2);
        }
    }
    release(&c);
    return result;
}
