"""A refiner with one bad habit, for `verify`: `python habits.py HABIT`.

It finds the point where gradients are orthogonal to the way to it, and gets one thing wrong. It needs numpy, and cornerbench.py beside the adapters.
"""

import sys

import numpy as np
from cornerbench import serve

habit = sys.argv[1]


def located(right, down, x, y):
    """The point of 11 x 11 pixels where gradients are orthogonal to the way to it, five times; or NaN."""
    for _ in range(5):
        column, row = int(np.rint(x)), int(np.rint(y))
        window = np.s_[max(row - 5, 0) : row + 6, max(column - 5, 0) : column + 6]
        gx, gy = right[window].ravel(), down[window].ravel()
        matrix = np.array([[gx @ gx, gx @ gy], [gx @ gy, gy @ gy]])
        if not np.linalg.det(matrix) > 1e-3 * np.trace(matrix) ** 2:
            return np.nan, np.nan
        py, px = (each[window].ravel() for each in np.indices(right.shape))
        along = gx * px + gy * py
        x, y = np.linalg.solve(matrix, [gx @ along, gy @ along])
    return x, y


def refine(exposure, seeds):
    """Answer, by habit."""
    image = exposure.image
    if min(image.shape) < 3:
        if habit == "crash on small pictures":
            raise IndexError("index 3 is out of bounds")
        return [None] * len(seeds)
    if habit == "declines all":
        return [None] * len(seeds)
    down, right = np.gradient(image.astype(float))
    answers = np.array([located(right, down, x, y) for x, y in seeds])
    if habit == "pixel's corner":
        answers += 0.5
    if habit == "from one":
        answers += 1.0
    if habit == "swapped":
        answers = answers[:, ::-1]
    if habit == "random":
        answers += np.random.default_rng().normal(0.0, 1e-3, answers.shape)
    if habit == "sorted":
        answers = answers[np.argsort(answers[:, 0])]
    if habit == "grid":
        answers = 2.0 * np.rint(answers / 2.0)
    if habit == "bright":
        answers += 0.02 * image.mean()
    return [None if not np.isfinite(one).all() else one for one in answers]


serve(refine=refine, version=habit)
