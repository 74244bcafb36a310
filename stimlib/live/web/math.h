/* What exported C takes of math.h, on WebAssembly without a C library. All round
   correctly; WebAssembly has instructions for all but fma and fmod. */
#ifndef WEB_MATH_H
#define WEB_MATH_H
#include <stdint.h>
#define INFINITY __builtin_inf()
#define NAN __builtin_nan("")
#define fabs __builtin_fabs
#define floor __builtin_floor
#define sqrt __builtin_sqrt
#define copysign __builtin_copysign
#define fma web_fma
#define fmod web_fmod
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

static inline uint64_t web_bits(double x)
{
    uint64_t u;
    __builtin_memcpy(&u, &x, 8);
    return u;
}

static inline double web_unbits(uint64_t u)
{
    double x;
    __builtin_memcpy(&x, &u, 8);
    return x;
}

static inline int web_exponent(double x) { return (int)(web_bits(x) >> 52 & 2047); }

/* m 2^e, m with 53 bits, of a number that is finite and not 0 */
static inline uint64_t web_split(double x, int *e)
{
    uint64_t m = web_bits(x) & ((UINT64_C(1) << 52) - 1);
    *e = web_exponent(x);
    if (*e) m |= UINT64_C(1) << 52;
    else *e = 1;
    for (; !(m >> 52); (*e)--) m <<= 1;
    *e -= 1075;
    return m;
}

/* m 2^e rounded to a double; the lowest bit of m also stands for what lies below it.
   m has 55 bits at least. */
static inline double web_round(uint64_t m, int e, int minus)
{
    int more = 11 - __builtin_clzll(m);
    uint64_t rest, u;
    if (e + more < -1074) more = -1074 - e;
    if (e + more > 971) return minus ? -INFINITY : INFINITY;
    for (; more > 60; more--, e++) m = m >> 1 | (m & 1);
    rest = m & ((UINT64_C(1) << more) - 1);
    u = m >> more;
    u += rest > UINT64_C(1) << (more - 1) || (rest == UINT64_C(1) << (more - 1) && u & 1);
    /* a carry goes into the exponent, and from the largest number to infinity */
    u += (uint64_t)(e + more + 1074) << 52;
    return web_unbits(u | (uint64_t)minus << 63);
}

/* By integers; for numbers of any size. */
static double web_fma_any(double a, double b, double c)
{
    uint64_t x, y, z, high, low, middle, part;
    int ea, eb, ec, minus, other, shift;
    if (a == 0.0 || b == 0.0 || web_exponent(a) == 2047 || web_exponent(b) == 2047) return a * b + c;
    if (web_exponent(c) == 2047) return c;
    x = web_split(a, &ea);
    y = web_split(b, &eb);
    minus = (int)((web_bits(a) ^ web_bits(b)) >> 63);
    /* the product in two words of 64 bits: 104 or 105 bits, times 2^(ea + eb) */
    part = (x & 0xffffffff) * (y & 0xffffffff);
    middle = (x >> 32) * (y & 0xffffffff) + (part >> 32);
    low = (x & 0xffffffff) * (y >> 32) + (middle & 0xffffffff);
    high = (x >> 32) * (y >> 32) + (middle >> 32) + (low >> 32);
    low = low << 32 | (part & 0xffffffff);
    ea += eb;
    /* its first bit to bit 125: there is room for a carry, and bits to round */
    shift = __builtin_clzll(high) - 2;
    high = high << shift | low >> (64 - shift);
    low <<= shift;
    ea -= shift;
    if (c != 0.0) {
        uint64_t zhigh, zlow = 0;
        z = web_split(c, &ec);
        other = (int)(web_bits(c) >> 63);
        zhigh = z << 9; /* bit 61 of the upper word, as the product has it */
        ec -= 73;
        if (ec > ea || (ec == ea && zhigh > high)) { /* the larger one first */
            uint64_t t = high;
            int k = ea;
            high = zhigh; zhigh = t;
            t = low; low = zlow; zlow = t;
            ea = ec; ec = k;
            k = minus; minus = other; other = k;
        }
        shift = ea - ec;
        if (shift > 126) { zlow = zhigh || zlow; zhigh = 0; }
        else {
            uint64_t lost = 0;
            if (shift >= 64) {
                lost = zlow;
                zlow = zhigh;
                zhigh = 0;
                shift -= 64;
            }
            if (shift) {
                lost |= zlow << (64 - shift);
                zlow = zlow >> shift | zhigh << (64 - shift);
                zhigh >>= shift;
            }
            zlow |= lost != 0;
        }
        if (minus == other) {
            low += zlow;
            high += zhigh + (low < zlow);
        } else {
            if (high < zhigh || (high == zhigh && low < zlow)) {
                minus = other;
                part = zlow - low;
                high = zhigh - high - (zlow < low);
                low = part;
            } else {
                part = low - zlow;
                high = high - zhigh - (low < zlow);
                low = part;
            }
            if (!(high | low)) return 0.0;
        }
    }
    /* as much as fits into one word, what is left over in its lowest bit */
    if (!high) { high = low; low = 0; ea -= 64; }
    shift = __builtin_clzll(high);
    if (shift) {
        high = high << shift | (low ? low >> (64 - shift) : 0);
        low <<= shift;
    }
    return web_round(high | (low != 0), ea + 64 - shift, minus);
}

/* a b + c, rounded once: Boldo & Melquiond (2008, algorithm of section 3.1), by sums of
   doubles where the product neither overflows nor loses bits; else by integers. */
static inline double web_fma(double a, double b, double c)
{
    const int e = web_exponent(a) + web_exponent(b);
    double p, q, s, t, u, v, w, high, low, ah, al, bh, bl;
    uint64_t bits;
    if (a == 0.0 || b == 0.0) return a * b + c;
    if (e < 1200 || e > 2900 || web_exponent(a) > 2000 || web_exponent(b) > 2000 || web_exponent(c) > 2000)
        return web_fma_any(a, b, c);
    t = 134217729.0 * a; ah = t - (t - a); al = a - ah;
    t = 134217729.0 * b; bh = t - (t - b); bl = b - bh;
    p = a * b;
    q = ((ah * bh - p) + ah * bl + al * bh) + al * bl; /* p + q = a b */
    s = c + q; t = s - c; u = (c - (s - t)) + (q - t); /* s + u = c + q */
    v = p + s; t = v - p; w = (p - (v - t)) + (s - t); /* v + w = p + s */
    high = w + u; t = high - w; low = (w - (high - t)) + (u - t);
    bits = web_bits(high);
    if (low != 0.0 && !(bits & 1)) /* to the odd one of the two neighbours */
        high = web_unbits((low > 0.0) == (high > 0.0) ? bits + 1 : bits - 1);
    return v + high;
}

static double web_fmod(double a, double b)
{
    uint64_t x, y;
    int ea, eb;
    if (a != a || b != b || b == 0.0 || web_exponent(a) == 2047) return a - a + NAN;
    if (a == 0.0 || fabs(a) < fabs(b)) return a;
    x = web_split(a, &ea);
    y = web_split(b, &eb);
    for (;; x <<= 1, ea--) {
        if (x >= y) x -= y;
        if (ea == eb || x == 0) break;
    }
    if (x == 0) return copysign(0.0, a);
    x <<= 2; /* exact */
    for (eb -= 2; !(x >> 54); eb--) x <<= 1;
    return web_round(x, eb, (int)(web_bits(a) >> 63));
}
#endif
