"""Detectors of pictures take part as detectors of exposures."""

import numpy as np


def in_region(detect, reach_px):
    """Search no more than the region that is asked for, as cornerbench's own detectors do.

    Parameters
    ----------
    detect
        ``detect(image, **parameters)`` returns points, n x 2, and their responses. It has to bear
        an image that is part of a larger one, rows not side by side, and not to be written to.
    reach_px
        How far beyond the region it is shown the image [px]: as far as a corner's surroundings
        count. Relative thresholds are of the strongest response in what is shown.

    Returns
    -------
    Callable
        The ``detect`` that ``serve`` takes: corners inside the region, strongest first.
    """

    def detect_in_region(exposure, **parameters):
        height, width = exposure.image.shape[:2]
        x0, y0, x1, y1 = exposure.region or (0, 0, width, height)
        left, top = max(x0 - reach_px, 0), max(y0 - reach_px, 0)
        shown = exposure.image[top : y1 + reach_px, left : x1 + reach_px]
        points, responses = detect(shown, **parameters)
        points = np.asarray(points, np.float64).reshape(-1, 2) + np.array([left, top])
        responses = np.asarray(responses, np.float64).reshape(-1)
        # A pixel ends half a pixel from its centre.
        inside = (points >= (x0 - 0.5, y0 - 0.5)) & (points < (x1 - 0.5, y1 - 0.5))
        kept = np.flatnonzero(inside.all(axis=1))
        order = kept[np.argsort(-responses[kept], kind="stable")]
        return points[order], responses[order]

    return detect_in_region
