/* An example of what the generator writes behind a model of one run: its step control, and texts of faults. */
#ifndef STEP_CONTROL_H
#define STEP_CONTROL_H

#include "lanes.h"

#define RTOL 1e-8
#define ATOL_GROWTH 1e-10 /* see Study in block.h */
#define ATOL_AHEAD 1.0
#define ATOL_LEAST 1e-2
#define LONGEST 0.0
#define NEWTON_CHANGE 0.0
#define STEPS_AT_MOST 1000000
#define N_STOPS 0

PRIVATE const double absolute[] = {1e-10, 1e-10}, stops[] = {0.0};
PRIVATE const char *const faults[] = {"the start could not be solved for", "the step became too short"};

const double scene_times[] = {0.0, 0.5, 1.0}, scene_nominal[] = {2.0, 0.0};
const char *const scene_names[] = {"omega", "x", ""};

#endif
