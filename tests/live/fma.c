/* fma and fmod of a shared page against those of the C library: prints differences. */
#include <stdio.h>
#include <math.h>
#include <string.h>
static double wanted(double a, double b, double c) { return fma(a, b, c); }
static double left(double a, double b) { return fmod(a, b); }
#undef INFINITY
#undef NAN
#include "web/math.h"
static uint64_t s = 88172645463325252u;
static uint64_t r(void)
{
    s ^= s << 13;
    s ^= s >> 7;
    s ^= s << 17;
    return s * 2685821657736338717u;
}
static const double odd[] = { 0.0, -0.0, 1.0, -1.0, 5e-324, -5e-324, 0x1p-1022,
                              0x1.fffffffffffffp1023, 1e-190, 3.0 };
static double any(void)
{
    const int wide[] = { 2046, 40, 4, 100, 600 };
    int kind = (int)(r() % 8);
    uint64_t u = r();
    if (kind == 0) return odd[r() % 10];
    if (kind == 1) u &= ~((UINT64_C(1) << r() % 52) - 1);
    if (kind == 2) u |= (UINT64_C(1) << r() % 52) - 1;
    if (kind > 2) {
        const uint64_t range = (uint64_t)wide[kind - 3];
        u = (u & ~(UINT64_C(2047) << 52)) | (1023 - range / 2 + r() % range) << 52;
    }
    return web_unbits(u);
}
static int same(double a, double b) { return a != a ? b != b : web_bits(a) == web_bits(b); }
int main(void)
{
    long i, bad = 0;
    for (i = 0; i < 300000; i++) {
        double a = any(), b = any(), c = any(), x;
        if (r() % 4 == 0) c = web_unbits(web_bits(-a * b) + r() % 9 - 4);
        else if (r() % 4 == 0) c = ldexp(a * b, (int)(r() % 220) - 110);
        x = wanted(a, b, c);
        bad += !same(x, web_fma(a, b, c)) + !same(x, web_fma_any(a, b, c));
        if (r() % 2) b = ldexp(a, -(int)(r() % 300)) * 1.7;
        bad += !same(left(a, b), web_fmod(a, b));
    }
    printf("%ld", bad);
    return 0;
}
