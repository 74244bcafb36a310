/* What the audio thread of a shared page calls: the scene, and what follows a hand. */
#include "scene.h"
#ifdef HAND
#include "hand.h"
#endif
#define MOST 128 /* samples at a time */
#define EXPORT(name) __attribute__((export_name(#name)))

static scene_state scene;
static double x[SCENE_INPUTS + 1][MOST], y[SCENE_OUTPUTS][MOST];
#ifdef HAND
static hand_state hand;
static double held[HAND_INPUTS][MOST];
#endif

EXPORT(inputs) double *inputs(void) { return x[0]; }
EXPORT(outputs) double *outputs(void) { return y[0]; }

EXPORT(begin) void begin(void)
{
    scene_init(&scene);
#ifdef HAND
    hand_init(&hand);
#endif
}

EXPORT(set) void set(int parameter, double value, double samples)
{
    scene_set(&scene, parameter, value, samples);
}

EXPORT(run) void run(int n)
{
    const double *in[SCENE_INPUTS + 1];
    double *out[SCENE_OUTPUTS];
    int k;
    for (k = 0; k <= SCENE_INPUTS; k++) in[k] = x[k];
    for (k = 0; k < SCENE_OUTPUTS; k++) out[k] = y[k];
    scene_process(&scene, in, out, n);
}

EXPORT(fault) int fault(void) { return SCENE_FAULT(&scene); }

#ifdef HAND
EXPORT(targets) double *targets(void) { return held[0]; }

/* The targets, smoothed, become the inputs. */
EXPORT(follow) void follow(int n)
{
    const double *in[HAND_INPUTS];
    double *out[HAND_OUTPUTS];
    int k;
    for (k = 0; k < HAND_INPUTS; k++) in[k] = held[k];
    for (k = 0; k < HAND_OUTPUTS; k++) out[k] = x[k];
    hand_process(&hand, in, out, n);
}
#endif
