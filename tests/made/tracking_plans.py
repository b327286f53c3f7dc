"""Plans for the tracking tests, from the quintics of equations.md 2.1 written out on their own."""

import numpy as np
from numpy.polynomial import Polynomial

from highd_lc.vocab.tracking import Reference

Z = Polynomial([0, 0, 0, 10, -15, 6])
Q = Polynomial([0, 0, 0, -4, 7, -3])


def quintic_reference(v0, shift, T, *, x_final=None, v_end=None, dt=0.1):
    """The plan x = v0 t + (x_final - v0 T) z + T (v_end - v0) q, y = D z at its samples."""
    v_end = v0 if v_end is None else v_end
    x_final = 0.5 * (v0 + v_end) * T if x_final is None else x_final
    u = np.arange(round(T / dt) + 1) * dt / T
    x = Polynomial([0, v0 * T]) + (x_final - v0 * T) * Z + T * (v_end - v0) * Q
    y = shift * Z
    derivative = [[p.deriv(k)(u) / T**k if k else p(u) for p in (x, y)] for k in range(3)]
    return Reference(dt, *derivative[0], *derivative[1], *derivative[2])
