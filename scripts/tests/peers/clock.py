"""How long a call takes."""

import time

import numpy as np


def times_s(call, repeats):
    """Return the least time that a call takes, the lower quartile and the median [s]."""
    took_s = []
    for _ in range(repeats):
        begun_s = time.perf_counter()
        call()
        took_s.append(time.perf_counter() - begun_s)
    least_s, quartile_s, median_s = np.quantile(took_s, (0.0, 0.25, 0.5))
    return {"least": least_s, "quartile": quartile_s, "median": median_s}
