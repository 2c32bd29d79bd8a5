/* A contact model as Python hands it over: the weights of a network, or an object that runs another graph (inference.py). */
#ifndef FMFTS_EVALUATED_H
#define FMFTS_EVALUATED_H

#include "../common/_binding.h"
#include "network.h"

/* Objects that are held while the network is used: its vector, or the method and the buffers of the object. All zeros
 * at first. */
typedef struct {
    Py_buffer vector, pose, contact, jacobian;
    PyObject *run;
} fmfts_model_given;

/* Takes a vector as in network.h, or an object with run(), pose, contact and jacobian. 0 and an exception if it is
 * neither, or has other than three or five outputs. An exception of run() makes all answers NaN, and stays set. */
int fmfts_take_model(PyObject *model, fmfts_model_given *given, fmfts_network *network);

void fmfts_release_model(fmfts_model_given *given);

#endif
