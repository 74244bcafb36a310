/* A stimulus in a loop of C or C++, without Python's lock: a compiled processor or
   exported C, called in the same way.

   A run is what processes: the context of Processor.address, or a state of exported C.
   One thread at a time may use a run; parameters are set by the thread that processes,
   between two calls. Nothing here allocates, waits or calls Python. */
#ifndef STIMLIB_H
#define STIMLIB_H
#include <stdint.h>
#include <string.h>

/* Compute n samples: x has a row of n for each input, y one for each output. */
typedef void (*stimlib_process)(void *run, const double *x, double *y, int64_t n);
/* Let a parameter, by its number, go to a value within so many samples; 0: at once. */
typedef void (*stimlib_set)(void *run, int parameter, double value, double samples);

/* stimlib_set of a compiled processor: it is taken in by the next call. A value that is
   not finite is not taken. */
static inline void stimlib_set_processor(void *run, int parameter, double value, double samples)
{
    int64_t *q = (int64_t *)(intptr_t)((int64_t *)run)[13] + 8 * parameter;
    const double left = samples > 1.0 ? samples : 0.0; /* a jump is there at once */
    if (value - value != 0.0 || parameter < 0 || parameter >= ((int64_t *)run)[14]) return;
    memcpy(q + 2, &value, 8);
    memcpy(q + 3, &left, 8);
    if (left == 0.0) memcpy(q + 4, &value, 8);
    q[0] = left == 0.0 || q[0] == 2 ? 2 : 1; /* a ramp begins where a waiting jump ends */
}
#endif
