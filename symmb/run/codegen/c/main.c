/* Runs the scene over its times and prints its outputs as CSV. Arguments set parameters: ./scene length=1.2 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene.h"

/* Sets the parameter of an argument "name=value". Returns 0 if no parameter has this name, or if the value is not a finite
   number. */
static int set_parameter(double *parameters, const char *argument) {
  const char *equals = strchr(argument, '=');
  for (int i = 0; i < SCENE_N_P && equals; ++i)
    if (strlen(scene_names[i]) == (size_t)(equals - argument) && !strncmp(scene_names[i], argument, equals - argument)) {
      char *rest;
      parameters[i] = strtod(equals + 1, &rest);
      return rest != equals + 1 && !*rest && isfinite(parameters[i]);
    }
  return 0;
}

/* Prints a name in quotes. Quotes within the name are doubled. */
static void print_name(const char *name) {
  printf(",\"");
  for (; *name; ++name) printf(*name == '"' ? "\"\"" : "%c", *name);
  printf("\"");
}

static void print_outputs(const Scene *scene, double t) {
  printf("%.17g", t);
  for (int i = 0; i < SCENE_N_Y; ++i) printf(",%.17g", scene_outputs(scene)[i]);
  printf("\n");
}

int main(int count, char **arguments) {
  Scene *scene = scene_new();
  if (!scene) return fprintf(stderr, "There is not enough memory.\n"), 1;
  for (int i = 1; i < count; ++i)
    if (!set_parameter(scene_parameters(scene), arguments[i])) {
      fprintf(stderr, "%s is not a parameter with a finite number. Write name=number.\n", arguments[i]);
      scene_free(scene);
      return 2;
    }
  int k = 0, goes_on = scene_start(scene, scene_times[SCENE_N_T - 1], 0.0);
  printf("t");
  for (int i = 0; i < SCENE_N_Y; ++i) print_name(scene_names[SCENE_N_P + i]);
  printf("\n");
  for (; goes_on && k < SCENE_N_T; ++k) {
    if (k && !(goes_on = scene_step(scene, scene_times[k]))) break;
    print_outputs(scene, scene_times[k]);
  }
  if (!goes_on) fprintf(stderr, "The run fails at t = %g s: %s.\n", scene_times[k], scene_fault(scene));
  scene_free(scene);
  return !goes_on;
}
