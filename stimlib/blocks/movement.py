"""Means over the movement of a sample: their base class, and the sines they need."""

from collections import namedtuple

from ..core.graph import NONE, ONE, Block
from ..core.maths import floor, fma, where

PI = 3.141592653589793

# State of blocks that average over position, between samples.
PlaceState = namedtuple("PlaceState", "last cold")


class Over(Block, abstract=True):
    """Base class of blocks that average a function of position over a sample's path.

    The mean lies half a sample late.
    """

    resettable = True

    def delay(self, p):
        """Return half a sample, the delay of a mean over the last sample period."""
        return 0.5


# sin(pi x)/x in x^2 for |x| <= 1/2;  (1 - sin(pi x)/(pi x))/x^2 in x^2 for |x| <= 1:
# relative errors below 1e-16
P0, P1, P2, P3 = 3.141592653589793, -5.167712780049969, 2.5501640398773007, -0.5992645293189447
P4, P5, P6, P7 = (
    0.0821458865731029,
    -0.007370430505916944,
    0.0004662998161898394,
    -2.1903497074626018e-05,
)
P8 = 7.697826768224191e-07
G0, G1, G2, G3 = 1.6449340668482264, -0.8117424252833536, 0.19075182412208397, -0.026147847817651126
G4, G5, G6, G7 = (
    0.002346081035426408,
    -0.000148428792893624,
    6.975873261074044e-06,
    -2.531209900320938e-07,
)
G8, G9, G10 = 7.303807539233181e-09, -1.709751764178703e-10, 3.058160916927997e-12


def sinpi(x):
    """Return sin(pi x) for |x| <= 1/2."""
    z = x * x
    return x * fma(
        fma(fma(fma(fma(fma(fma(fma(P8, z, P7), z, P6), z, P5), z, P4), z, P3), z, P2), z, P1),
        z,
        P0,
    )


def gap(x):
    """Return 1 - sin(pi x)/(pi x) for |x| <= 1.

    It is the fraction of a sinusoid that averaging over x periods removes.
    """
    z = x * x
    q = fma(fma(fma(fma(fma(G10, z, G9), z, G8), z, G7), z, G6), z, G5)
    return z * fma(fma(fma(fma(fma(q, z, G4), z, G3), z, G2), z, G1), z, G0)


def sine_of_half_turns(h):
    """Return sin(pi h), h in half turns."""
    r = h - 2.0 * floor(0.5 * h + 0.5)  # -1 .. 1
    return sinpi(where(r > 0.5, 1.0 - r, where(r < -0.5, -1.0 - r, r)))


def averaged(d):
    """Return sin(pi d)/(pi d), the effect on a sinusoid of averaging over d periods."""
    near = abs(d) < 1.0
    return where(
        near, 1.0 - gap(where(near, d, 0.0)), sine_of_half_turns(d) / (PI * where(near, 1.0, d))
    )


def regular(duty):
    """Return the number of samples with the same duty cycle as the first."""
    n = NONE
    for i in range(duty.size):
        n = n + where(duty[i] == duty[0], ONE, NONE)
    return n
