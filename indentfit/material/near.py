"""Sums over three principal stretches that lie close together, in one compiled loop over the points.

`stretches` says what is computed, and has the same in NumPy for few points. This module is imported where there are many, because
Numba is slow to import.
"""

from typing import Any

from indentfit.compiled import compiled, on_stack

_kernel = compiled(error_model="numpy", fastmath={"contract", "nsz"})


@_kernel
def near_sums(c: Any, P: Any, terms: Any, out: Any) -> None:
    """Sums at mean c (n,) and spread P (n,) of the roots, from the series' terms (functions, order + 1, n), into out.

    out (functions, 1, 3 or 6, n): the sums, with their first, with their second derivatives by I1 and I2.
    """
    power, single, double = on_stack((40,)), on_stack((40,)), on_stack((40,))
    w = on_stack((6,))
    rows, last = out.shape[1], terms.shape[1]
    for p in range(c.size):
        x, y = P[p], 1.0 / (c[p] * c[p] * c[p]) - 1.0 + P[p]
        length = last if abs(x) > 3e-4 else min(last, 16)  # a spread of 3e-4 is a distance of 0.02
        power[0], power[1], power[2] = 3.0, 0.0, 2.0 * x
        single[0], single[1], single[2] = 0.0, 0.0, 1.0
        for n in range(5):
            double[n] = 0.0
        double[5] = 1.0
        for n in range(3, length + 3):
            power[n] = x * power[n - 2] + y * power[n - 3]
            single[n] = x * single[n - 2] + y * single[n - 3]
        if rows > 3:
            for n in range(6, length + 5):
                double[n] = 2.0 * (x * double[n - 2] + y * double[n - 3]) - x * x * double[n - 4] - 2.0 * x * y * double[n - 5]
                if n > 6:
                    double[n] -= y * y * double[n - 6]
        i = 1.0 / c[p]
        for f in range(out.shape[0]):
            for r in range(rows):
                out[f, r, p] = 0.0
        for k in range(length):
            n = k - 1
            w[0] = power[k]
            if k > 0 and rows > 1:
                w[1] = k * i * (single[n] + 2.0 * single[n + 1] + single[n + 2])
                w[2] = -k * i * i * (single[n] + single[n + 1])
            if k > 0 and rows > 3:
                a, b = double[n] + double[n + 1], double[n + 1] + double[n + 2]
                d, e = double[n + 2] + double[n + 3], double[n + 3] + double[n + 4]
                w[3] = k * i**2 * (a + 3.0 * b + 3.0 * d + e)
                w[4] = -k * i**3 * (a + 2.0 * b + d)
                w[5] = k * i**4 * (a + b)
            for f in range(out.shape[0]):
                for r in range(rows if k else 1):
                    out[f, r, p] += w[r] * terms[f, k, p]
