/* An example of the text that the generator writes after the model of a single run: step control and texts of faults. */
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
#define N_STOPS 0       /* instants of sampled values */
#define N_TIMES 0       /* linear switches of time. A switch with knots switches at its knots, otherwise at 0 */
#define STOPS_AT_MOST 0 /* maximum number of stops of both kinds */

PRIVATE const double absolute[] = {1e-10, 1e-10}, stops[] = {0.0}, knots[] = {0.0};
PRIVATE const int n_knots[] = {0};
PRIVATE const char *const faults[] = {"the start could not be computed", "the step became too short"};

const double scene_times[] = {0.0, 0.5, 1.0}, scene_nominal[] = {2.0, 0.0};
const char *const scene_names[] = {"omega", "x", ""};

#endif
