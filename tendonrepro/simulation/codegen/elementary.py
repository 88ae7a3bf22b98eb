"""Elementary functions from plain arithmetic, of floats, arrays and symbols.

A library call would end work on several lanes at a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tendonrepro.arrays import Numeric, choose

LN2_HIGH = 6.93147180369123816490e-01
"""Natural logarithm of 2 to 33 bits: its product with a small whole number is exact."""
LN2_LOW = 1.90821492927058770002e-10

PI_HIGH = 3.1415926534682512
"""π to 33 bits."""
PI_LOW = 1.2154201013012384e-10

EXP_TERMS = tuple(1.0 / math.factorial(k) for k in range(13))
SIN_TERMS = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(10))
LOG_TERMS = tuple(2.0 / (2 * k + 1) for k in range(11))

SMALLEST = 2.0**-1022
"""Smallest normal number."""
LARGEST_EXPONENT = 700.0
"""Arguments of ``exp`` beyond ± this are held there: 1e±304, still a normal number."""
SATURATED = 20.0
"""``tanh`` beyond this is one to rounding."""


def exp(x: Numeric) -> Numeric:
    """``e^x``, relative error below 1e-15 for |x| <= 700."""
    return _exp_near(np.minimum(np.maximum(x, -LARGEST_EXPONENT), LARGEST_EXPONENT))


def _exp_near(x: Numeric) -> Numeric:
    k = np.floor(x * (1.0 / math.log(2.0)) + 0.5)
    r = x - k * LN2_HIGH - k * LN2_LOW
    return horner(r, EXP_TERMS) * np.exp2(k)


def tanh(x: Numeric) -> Numeric:
    """Hyperbolic tangent, absolute error below 4e-16."""
    x = np.minimum(np.maximum(x, -SATURATED), SATURATED)
    grown = _exp_near(2.0 * x)
    return (grown - 1.0) / (grown + 1.0)


def sin(x: Numeric) -> Numeric:
    """Sine, absolute error below 1e-15 for |x| <= 1000."""
    k = np.floor(x * (1.0 / math.pi) + 0.5)
    return _sine_near(x - k * PI_HIGH - k * PI_LOW, k)


def cos(x: Numeric) -> Numeric:
    """Cosine, absolute error below 1e-15 for |x| <= 1000."""
    k = np.floor(x * (1.0 / math.pi) + 1.0)
    half = k - 0.5
    return _sine_near(x - half * PI_HIGH - half * PI_LOW, k)


def _sine_near(r: Numeric, k: Numeric) -> Numeric:
    """``(-1)^k sin(r)`` for |r| <= π/2."""
    sign: Numeric = (-1.0) ** k
    return sign * r * horner(r * r, SIN_TERMS)


def log(x: Numeric) -> Numeric:
    """Natural logarithm, error below 4e-16 max(1, |log x|); zero counts as `SMALLEST`."""
    mantissa, exponent = np.frexp(np.maximum(x, SMALLEST))
    small = mantissa < math.sqrt(0.5)
    mantissa = choose(small, 2.0 * mantissa, mantissa)
    exponent = choose(small, exponent - 1.0, exponent)
    ratio = (mantissa - 1.0) / (mantissa + 1.0)
    logarithm: Numeric = exponent * LN2_LOW + ratio * horner(ratio * ratio, LOG_TERMS) + exponent * LN2_HIGH
    return logarithm


def power(x: Numeric, b: Numeric) -> Numeric:
    """``x^b`` for x >= 0, relative error below 1e-15 (1 + |b log x|)."""
    return exp(b * log(x))


def horner(x: Numeric, terms: Sequence[float]) -> Numeric:
    """Polynomial, constant term first."""
    value: Numeric = terms[-1]
    for term in reversed(terms[:-1]):
        value = value * x + term
    return value
