/* The magnets of a frame for Python: poses.py and free_poses.py call it, and make the arrays. */
#include "_arrays.h"

/* poses(model, work, unfelt, fingers, fingers_covariance, misfit, variance, foreign, used, ambient, change, position, axis,
 * pose_variance, pose_covariance): the last is empty where it is not asked for. */
FMFTS_FUNCTION(poses)
{
    enum { UNFELT = FIRST, FINGERS, COVARIANCE, MISFIT, OF_FIELD, CHANGE = OF_FIELD + 4, POSITION, AXIS, VARIANCE, OF_POSES, ALL };
    call c = {.buffer = b};
    fmfts_measured measured;
    if (!take(&c, args, CHANGE, ALL) || !understood(&c, FINGERS)) {
        return NULL;
    }
    const size_t unknowns = FMFTS_FINGER * c.fingers, numbers = c.model.poses, places = 3 * c.model.magnets;
    const size_t covariances = c.buffer[OF_POSES].len ? numbers * numbers : 0;
    const size_t found[] = {numbers, places, places, numbers, covariances};
    if (!has_doubles(&c, UNFELT, FMFTS_POSE_CHANGE) || !has_doubles(&c, COVARIANCE, unknowns * unknowns) ||
        !has_doubles(&c, MISFIT, c.model.values) || !measures(&c, OF_FIELD, &measured) ||
        !have_doubles(&c, CHANGE, found, ALL - CHANGE)) {
        return NULL;
    }
    const fmfts_fitted fitted = {fingers(&c, FINGERS), array(&c, COVARIANCE), array(&c, MISFIT), 0.0};
    fmfts_poses poses = {
        .change = array(&c, CHANGE),
        .position = array(&c, POSITION),
        .axis = array(&c, AXIS),
        .variance = array(&c, VARIANCE),
        .covariance = covariances ? array(&c, OF_POSES) : NULL,
    };
    return told(fmfts_poses_of(&c.model, array(&c, UNFELT), &fitted, &measured, c.work, &poses), 0.0);
}

/* free_poses(model, work, limits, start, field, variance, foreign, used, ambient, change, covariance, misfit, found_ambient,
 * by_pose, counted, position, axis) */
FMFTS_FUNCTION(free_poses)
{
    enum { LIMITS = FIRST, START, FIELD, CHANGE = FIELD + 5, COVARIANCE, MISFIT, AMBIENT, BY_POSE, COUNTED, POSITION, AXIS, ALL };
    _Static_assert((int)ALL <= (int)FMFTS_MOST_ARRAYS, "more arrays than one call takes");
    call c = {.buffer = b};
    fmfts_measured measured;
    if (!take(&c, args, CHANGE, ALL) || !has_model(&c)) {
        return NULL;
    }
    const size_t values = c.model.values, numbers = c.model.poses, places = 3 * c.model.magnets;
    const size_t found_doubles[] = {numbers, numbers * numbers, values, 3, values * numbers, numbers, places, places};
    if (!have_doubles(&c, LIMITS, (size_t[]){sizeof(fmfts_free_limits) / sizeof(double), numbers}, FIELD - LIMITS) ||
        !measures_field(&c, FIELD, &measured) || !have_doubles(&c, CHANGE, found_doubles, ALL - CHANGE)) {
        return NULL;
    }
    fmfts_free_poses found = {
        .change = array(&c, CHANGE),
        .covariance = array(&c, COVARIANCE),
        .misfit_t = array(&c, MISFIT),
        .ambient_t = array(&c, AMBIENT),
        .by_pose = array(&c, BY_POSE),
        .counted = array(&c, COUNTED),
        .position = array(&c, POSITION),
        .axis = array(&c, AXIS),
    };
    const fmfts_free_limits *limits = c.buffer[LIMITS].buf;
    fmfts_refusal refusal = fmfts_free_poses_of(&c.model, limits, array(&c, START), &measured, c.work, &found);
    return told(refusal, found.chi2);
}
