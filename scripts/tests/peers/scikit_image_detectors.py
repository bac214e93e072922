"""scikit-image's detectors; `detectors.py` says what the functions are.

Slopes are Sobel's, 8 times ours. Gaussians end at 4 sigma, rounded; ours end at 3 sigma, rounded
up: at SIGMA both are of 11 samples. Beyond the picture all is 0.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
# scikit-image says no types; what is inferred from its defaults is too narrow.

import numpy as np
import skimage
from skimage import feature

VERSION = skimage.__version__
K = 0.04
SIGMA = 1.35
SLOPE = 8.0
RADIUS_PX = 2
# The strongest response is at the border, which is ours no more: not relative to it [DN^4/px^4].
HARRIS_THRESHOLD = 1e4
THRESHOLD_REL = 0.3
FAST_ARC_PX = 9
FAST_THRESHOLD = 20.0


def responses(picture):
    """Return responses, of floats of single precision: by bytes they would be of double."""
    floats = picture.astype(np.float32)
    determinant, trace = SLOPE**-4, SLOPE**-2

    def harris(**options):
        return lambda: feature.corner_harris(floats, sigma=SIGMA, **options)

    return {
        "harris": (harris(k=K), determinant),
        "rohr": (harris(k=0.0), determinant),
        "noble": (harris(method="eps", eps=1e-6 * SLOPE**2), 0.5 * trace),
        "shi_tomasi": (lambda: feature.corner_shi_tomasi(floats, sigma=SIGMA), trace),
        "foerstner": (lambda: feature.corner_foerstner(floats, sigma=SIGMA)[0], trace),
        "fast": (lambda: feature.corner_fast(floats, FAST_ARC_PX, FAST_THRESHOLD) > 0.0, 1.0),
    }


def points(picture):
    """Return maxima in squares."""
    floats = picture.astype(np.float32)

    def peaks(response, **thresholds):
        found = feature.corner_peaks(
            response, min_distance=RADIUS_PX, exclude_border=RADIUS_PX, **thresholds
        )
        return found[:, ::-1]

    def harris_peaks():
        response = feature.corner_harris(floats, k=K, sigma=SIGMA)
        return peaks(response, threshold_abs=HARRIS_THRESHOLD * SLOPE**4)

    def kitchen_rosenfeld_peaks():
        response = np.abs(feature.corner_kitchen_rosenfeld(floats, mode="nearest"))
        return peaks(response, threshold_rel=THRESHOLD_REL)

    return {"harris_peaks": harris_peaks, "kitchen_rosenfeld_peaks": kitchen_rosenfeld_peaks}
