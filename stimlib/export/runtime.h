/* What exported steps are made of. Only functions that round correctly are taken from
   the C library: fma, sqrt, floor, fabs. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__FAST_MATH__)
#error "the samples would differ: compile without -ffast-math"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "the samples would differ: compile without excess precision (-msse2 -mfpmath=sse)"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#define ST_INLINE static inline
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-variable"
#ifdef __clang__
#pragma GCC diagnostic ignored "-Wparentheses-equality"
#else
#pragma GCC diagnostic ignored "-Wunused-but-set-variable"
#endif
#endif

typedef struct { double *p; int64_t n; } st_floats;
/* words may lie in memory of doubles */
typedef struct { unsigned char *p; int64_t n; } st_words;

ST_INLINE st_floats st_floats_of(const double *p, int64_t n)
{
    st_floats a;
    a.p = (double *)p;
    a.n = n;
    return a;
}

ST_INLINE st_words st_words_of(const void *p, int64_t n)
{
    st_words a;
    a.p = (unsigned char *)p;
    a.n = n;
    return a;
}

ST_INLINE uint64_t st_word(st_words a, int64_t i)
{
    uint64_t u;
    memcpy(&u, a.p + 8 * i, 8);
    return u;
}

ST_INLINE void st_put_word(st_words a, int64_t i, uint64_t u) { memcpy(a.p + 8 * i, &u, 8); }

/* An index; below 0 it counts from the end, as in Python. */
ST_INLINE int64_t st_at(int64_t i, int64_t n) { return i < 0 ? i + n : i; }

/* The same for the end of a slice, which may lie outside. */
ST_INLINE int64_t st_end(int64_t i, int64_t n)
{
    i = st_at(i, n);
    return i < 0 ? 0 : i < n ? i : n;
}

ST_INLINE st_floats st_floats_cut(st_floats a, int64_t low, int64_t high)
{
    low = st_end(low, a.n);
    high = st_end(high, a.n);
    return st_floats_of(a.p + low, high > low ? high - low : 0);
}

ST_INLINE st_words st_words_cut(st_words a, int64_t low, int64_t high)
{
    low = st_end(low, a.n);
    high = st_end(high, a.n);
    return st_words_of(a.p + 8 * low, high > low ? high - low : 0);
}

ST_INLINE void st_floats_fill(st_floats a, double v)
{
    int64_t i;
    for (i = 0; i < a.n; i++) a.p[i] = v;
}

ST_INLINE void st_floats_fill_from(st_floats a, st_floats b)
{
    if (b.n == 1) st_floats_fill(a, b.p[0]);
    else memmove(a.p, b.p, (size_t)(a.n < b.n ? a.n : b.n) * sizeof *a.p);
}

ST_INLINE void st_words_fill(st_words a, uint64_t u)
{
    int64_t i;
    for (i = 0; i < a.n; i++) st_put_word(a, i, u);
}

ST_INLINE void st_words_fill_from(st_words a, st_words b)
{
    if (b.n == 1) st_words_fill(a, st_word(b, 0));
    else memmove(a.p, b.p, (size_t)(a.n < b.n ? a.n : b.n) * 8);
}

ST_INLINE int64_t st_abs(int64_t i) { return i < 0 ? (int64_t)(0 - (uint64_t)i) : i; }

ST_INLINE st_words st_as_words(st_floats a) { return st_words_of(a.p, a.n); }

/* A float as a whole number: of one that is beyond, what numpy makes of it on x86. */
ST_INLINE int64_t st_to_whole(double x)
{
    return fabs(x) < 9223372036854775808.0 ? (int64_t)x : INT64_MIN;
}

/* The same as a word. */
ST_INLINE uint64_t st_to_word(double x)
{
    const double most = 9223372036854775808.0;
    const int high = x >= most;
    if (high)
        x -= most;
    return (uint64_t)st_to_whole(x) ^ (uint64_t)high << 63;
}

ST_INLINE double st_flush(double x) { return fabs(x) <= 1e-250 ? 0.0 : x; }

/* Shifts by 64 and more, and divisions by 0, as numpy has them. */
ST_INLINE uint64_t st_left_word(uint64_t u, uint64_t by) { return by < 64 ? u << by : 0; }
ST_INLINE uint64_t st_right_word(uint64_t u, uint64_t by) { return by < 64 ? u >> by : 0; }
ST_INLINE uint64_t st_rest_word(uint64_t u, uint64_t by) { return by != 0 ? u % by : 0; }
ST_INLINE uint64_t st_quotient_word(uint64_t u, uint64_t by) { return by != 0 ? u / by : 0; }

ST_INLINE int64_t st_left(int64_t i, int64_t by)
{
    return (int64_t)st_left_word((uint64_t)i, (uint64_t)by);
}

ST_INLINE int64_t st_right(int64_t i, int64_t by) { return i >> (by < 0 || by > 63 ? 63 : by); }

/* The number after i in a range; its end where that may lie beyond 64 bits. */
ST_INLINE int64_t st_next(int64_t i, int64_t by, int64_t end)
{
    const uint64_t left = (uint64_t)end - (uint64_t)i;
    return (by > 0 ? left > (uint64_t)by : left < (uint64_t)by) ? i + by : end;
}

ST_INLINE int64_t st_rest(int64_t a, int64_t b)
{
    int64_t r = b == 0 || b == -1 ? 0 : a % b;
    return r != 0 && (r < 0) != (b < 0) ? r + b : r;
}

ST_INLINE int64_t st_quotient(int64_t a, int64_t b)
{
    if (b == 0 || b == -1) return b == 0 ? 0 : (int64_t)(0 - (uint64_t)a);
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}

ST_INLINE double st_mod(double a, double b)
{
    double r = fmod(a, b);
    return r == 0.0 ? copysign(0.0, b) : (r < 0) != (b < 0) ? r + b : r;
}

ST_INLINE int64_t st_search(st_floats knots, double x, double per)
{
    int64_t low = 0, high = knots.n - 2;
    if (per > 0.0) {
        double guess = (x - knots.p[0]) * per - 0.5;
        low = guess > 0.0 ? (int64_t)(guess < (double)high ? guess : (double)high) : 0;
        low += x >= knots.p[low + 1];
        return low < high ? low : high;
    }
    while (low < high) {
        int64_t k = (low + high + 1) >> 1;
        if (x >= knots.p[k]) low = k;
        else high = k - 1;
    }
    return low;
}

ST_INLINE void st_copy(st_floats a, st_floats b) { memmove(b.p, a.p, (size_t)a.n * sizeof *a.p); }

ST_INLINE double st_total(const double *s)
{
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

/* Four samples at a time, so that each tap is read once for four of them. */
ST_INLINE void st_fir(st_floats taps, st_floats w, st_floats y)
{
    int64_t i, j;
    int k;
    for (i = 0; i + 4 <= y.n; i += 4) {
        double a[8] = {0}, b[8] = {0}, c[8] = {0}, d[8] = {0};
        for (j = 0; j < taps.n; j += 8) {
            const double *t = taps.p + j, *x = w.p + i + j;
            for (k = 0; k < 8; k++) {
                a[k] = fma(t[k], x[k], a[k]);
                b[k] = fma(t[k], x[k + 1], b[k]);
                c[k] = fma(t[k], x[k + 2], c[k]);
                d[k] = fma(t[k], x[k + 3], d[k]);
            }
        }
        y.p[i] = st_total(a);
        y.p[i + 1] = st_total(b);
        y.p[i + 2] = st_total(c);
        y.p[i + 3] = st_total(d);
    }
    for (; i < y.n; i++) {
        double a[8] = {0};
        for (j = 0; j < taps.n; j += 8)
            for (k = 0; k < 8; k++) a[k] = fma(taps.p[j + k], w.p[i + j + k], a[k]);
        y.p[i] = st_total(a);
    }
}

/* Eight modes at a time, so that a compiler keeps them in registers; the eight partial
   sums of each sample are in w. */
ST_INLINE void st_clear(st_floats w, int64_t n)
{
    int64_t i;
    for (i = 0; i < 8 * n; i++) w.p[i] = 0.0;
}

ST_INLINE void st_modes(st_floats p, st_floats r, st_floats q, double d, st_floats x, st_floats y,
                        st_floats w)
{
    int64_t i, j;
    int k;
    st_clear(w, y.n);
    for (j = 0; j < p.n; j += 8) {
        double a[8], b[8], c[8];
        for (k = 0; k < 8; k++) { a[k] = p.p[j + k]; b[k] = r.p[j + k]; c[k] = q.p[j + k]; }
        for (i = 0; i < y.n; i++) {
            const double v = x.p[i] + 1e-260;
            double *s = w.p + 8 * i;
            for (k = 0; k < 8; k++) {
                c[k] = fma(a[k], c[k], v);
                s[k] = fma(b[k], c[k], s[k]);
            }
        }
        for (k = 0; k < 8; k++) q.p[j + k] = c[k];
    }
    for (i = 0; i < y.n; i++) y.p[i] = st_flush(fma(d, x.p[i], st_total(w.p + 8 * i)));
}

ST_INLINE void st_memory(st_floats e, st_floats r, st_floats q, st_floats low, st_floats x,
                         st_floats y, st_floats w)
{
    int64_t i, j;
    int k;
    st_clear(w, y.n);
    for (j = 0; j < e.n; j += 8) {
        double a[8], c[8], f[8];
        for (k = 0; k < 8; k++) {
            a[k] = -e.p[j + k];
            c[k] = q.p[j + k];
            f[k] = j < low.n ? low.p[j + k] : 0.0;
        }
        for (i = 0; i < y.n; i++) {
            const double v = x.p[i] + 1e-260;
            const double *b = r.p + j + (r.n > e.n ? e.n * i : 0);
            double *s = w.p + 8 * i;
            if (j < low.n)
                for (k = 0; k < 8; k++) {
                    const double t = fma(a[k], c[k], v) + f[k], next = c[k] + t;
                    f[k] = t - (next - c[k]);
                    c[k] = next;
                    s[k] = fma(b[k], next, s[k]);
                }
            else
                for (k = 0; k < 8; k++) {
                    c[k] = c[k] + fma(a[k], c[k], v);
                    s[k] = fma(b[k], c[k], s[k]);
                }
        }
        for (k = 0; k < 8; k++) q.p[j + k] = c[k];
        for (k = 0; k < 8 && j < low.n; k++) low.p[j + k] = f[k];
    }
    for (i = 0; i < y.n; i++) y.p[i] = st_flush(st_total(w.p + 8 * i));
}

/* m series of Chebyshev at each t, beside each other in c and in y; Clenshaw's method. */
ST_INLINE void st_chebyshev(st_floats c, st_floats t, st_floats y)
{
    const int64_t m = y.n / t.n;
    int64_t i, j, k;
    for (i = 0; i < t.n; i++)
        for (j = 0; j < m; j++) {
            double a = 0.0, b = 0.0;
            for (k = c.n - m + j; k > j; k -= m) {
                const double next = fma(2.0 * t.p[i], a, c.p[k] - b);
                b = a;
                a = next;
            }
            y.p[m * i + j] = fma(t.p[i], a, c.p[j] - b);
        }
}

/* Of doubles, in single precision too. */
ST_INLINE uint64_t st_bits(double x)
{
    uint64_t u;
    memcpy(&u, &x, 8);
    return u;
}

ST_INLINE double st_unbits(uint64_t u)
{
    double x;
    memcpy(&x, &u, 8);
    return x;
}
