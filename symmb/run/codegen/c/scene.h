/* One run of a scene. A program chooses its parameters and times. This is an example of the header that the generator writes,
   for the oscillator of model.h.

   Functions that return int return 0 if the run fails. scene_fault then returns the reason. */
#ifndef SCENE_H
#define SCENE_H

#define SCENE_N_P 1        /* parameters, followed by inputs */
#define SCENE_N_INPUTS 0
#define SCENE_N_X 2        /* states */
#define SCENE_N_Y 1        /* outputs */
#define SCENE_N_SWITCHES 0
#define SCENE_HAS_RATES 1  /* 1: other programs may integrate the states, because there are no constraints and no impacts */
#define SCENE_N_T 3        /* times */
#define SCENE_TOKEN "example" /* a text that identifies this scene */

typedef struct Scene Scene;

extern const double scene_times[SCENE_N_T], scene_nominal[SCENE_N_P + 1];
extern const char *const scene_names[SCENE_N_P + SCENE_N_Y + 1]; /* of parameters and outputs */

Scene *scene_new(void); /* with nominal parameters; NULL if there is not enough memory */
void scene_free(Scene *scene);

/* Parameters, which may be changed before scene_start. During a run, scene_change continues the run with changed parameters. */
double *scene_parameters(Scene *scene);
int scene_start(Scene *scene, double end, double tolerance); /* at scene_times[0]; tolerance 0: that of the scene */
int scene_step(Scene *scene, double t);
int scene_change(Scene *scene);
void scene_states(const Scene *scene, double *x);
const double *scene_outputs(const Scene *scene);
const char *scene_fault(const Scene *scene);

/* If SCENE_HAS_RATES: sets other states, times and parameters, and returns their rates, outputs and switches. The branches of
   the equations do not change until scene_settle. */
void scene_move(Scene *scene, double t, const double *x);
void scene_renew(Scene *scene);
void scene_rates(Scene *scene, double *rates);
void scene_switches(Scene *scene, double *switches);
void scene_settle(Scene *scene);
double scene_next_event(const Scene *scene); /* the next switch of time, infinite without one */

#endif
