/* How a finger may accelerate the magnet: along the directions in which presses move it.
 *
 * The finger's force and place are modelled as twice integrated white noise. With S [5][outputs] the slopes of the
 * pad's response at the last contact, the magnet's pose accelerates as white noise of the power density
 *
 *     W = S diag(q) S^T,  q: drive_power, for x, y and each load
 *
 * While nothing touches the pad, the next place is unknown: W is then the mean over the pad (drive.py). */
#include <math.h>
#include <string.h>

#include "now.h"

enum { MOVED = FMFTS_MOVED, CONTACT = FMFTS_CONTACT };

bool fmfts_drive(const fmfts_now_parameters *parameters, const void *response, size_t response_bytes,
                 const fmfts_estimate *estimate, double *drive)
{
    fmfts_response table;
    double change[MOVED], slope[MOVED][FMFTS_MAX_PRESS], turned[MOVED][CONTACT];
    if (!estimate) {
        memcpy(drive, parameters->untouched_drive, sizeof parameters->untouched_drive);
        return true;
    }
    if (!response || !fmfts_view_response(response, response_bytes, &table) || (int)table.loads != estimate->outputs - 2) {
        return false;
    }
    const double *place = estimate->place;
    double press[CONTACT] = {place[0] * 1e3, place[1] * 1e3, fmax(place[2], 0.0)};
    for (int load = 3; load < estimate->outputs; load++) {
        press[load] = place[load];
    }
    fmfts_respond(&table, press, change, slope);
    for (int i = 0; i < MOVED; i++) {
        for (int c = 0; c < estimate->outputs; c++) {
            turned[i][c] = 0.0;
            for (int k = 0; k < MOVED; k++) {
                turned[i][c] += parameters->to_pose[MOVED * i + k] * slope[k][c];
            }
        }
    }
    for (int i = 0; i < MOVED; i++) {
        for (int j = 0; j < MOVED; j++) {
            double sum = 0.0;
            for (int c = 0; c < estimate->outputs; c++) {
                sum += turned[i][c] * parameters->drive_power[c] * turned[j][c];
            }
            drive[MOVED * i + j] = sum;
        }
    }
    return true;
}
