#!/usr/bin/env python3
"""Makes scipy.csv, which the filters' tests are held against:

    pip install scipy==1.17.1
    python scipy.py > scipy.csv

The file must not be imported as `scipy`, so the folder is taken off the path first.
"""

import sys

sys.path.pop(0)

import numpy as np  # noqa: E402
from scipy.signal import butter, freqz, group_delay, remez  # noqa: E402

FREQUENCIES = [1, 20, 50, 162, 400, 1000, 2000, 4500, 8000]


def row(name, sampling, parameter, quantity, at, value):
    print(f"{name},{sampling},{parameter},{quantity},{at},{value.real:.17g},{value.imag:.17g}")


def response(name, sampling, parameter, b, a):
    _, values = freqz(b, a, worN=FREQUENCIES, fs=sampling)
    for frequency, value in zip(FREQUENCIES, values):
        row(name, sampling, parameter, "response", frequency, value)


print("filter,sampling,parameter,quantity,at,re,im")
for sampling in [20_000, 40_000, 60_000]:
    for cutoff in [50, 400, 1000]:
        b, a = butter(2, cutoff, fs=sampling)
        for name, coefficients in [("b", b), ("a", a)]:
            for k, coefficient in enumerate(coefficients):
                row("low_pass", sampling, cutoff, name, k, coefficient)
        _, delay = group_delay((b, a), w=[0], fs=sampling)
        row("low_pass", sampling, cutoff, "delay", 0, delay[0])
        response("low_pass", sampling, cutoff, b, a)
    for taps in [sampling // 1000 + 1, 31, 101]:
        passes, stops = 1000, 1000 + 4 * sampling / (taps - 1)
        # The relative error in the pass band, and that of the stop band by what 1 kHz has.
        h = remez(
            taps,
            [0, passes, stops, sampling / 2],
            [1, 0],
            weight=[1, sampling / passes],
            type="differentiator",
            fs=sampling,
            grid_density=2048,
            maxiter=200,
        )
        for k, tap in enumerate(h):
            row("differentiator", sampling, taps, "tap", k, tap)
        response("differentiator", sampling, taps, h, 1)
