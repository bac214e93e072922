"""OpenCV's detectors; `detectors.py` says what the functions are."""

import cv2
import numpy as np

VERSION = cv2.__version__
K = 0.04
QUALITY_LEVEL = 0.01
MIN_DISTANCE_PX = 3.0
FAST_THRESHOLD = 20

cv2.setNumThreads(1)


def gaussian_harris(picture):
    """Return Harris's response by central differences and a Gaussian window, of OpenCV's parts."""
    difference = np.array([[-0.5, 0.0, 0.5]])
    one = np.array([[1.0]])
    border = cv2.BORDER_REPLICATE
    x = cv2.sepFilter2D(picture, cv2.CV_32F, difference, one, borderType=border)
    y = cv2.sepFilter2D(picture, cv2.CV_32F, one, difference, borderType=border)
    a, b, c = (cv2.GaussianBlur(p, (11, 11), 1.5, borderType=border) for p in (x * x, y * y, x * y))
    return a * b - c * c - K * (a + b) ** 2


def responses(picture):
    """Return responses; OpenCV's tensor is 4 times ours, of bytes divided by 255^2."""
    floats = picture.astype(np.float32)
    out = np.empty_like(floats)  # memory for each in turn
    return {
        "harris": (lambda: cv2.cornerHarris(picture, 3, 3, K, out), 255.0**4 / 16.0),
        "harris_float": (lambda: cv2.cornerHarris(floats, 3, 3, K, out), 1.0 / 16.0),
        "min_eigenvalue": (lambda: cv2.cornerMinEigenVal(picture, 3, out), 255.0**2 / 4.0),
        "gaussian_harris": (lambda: gaussian_harris(picture), 1.0),
    }


def points(picture):
    """Return points; the third number of FAST's is the score."""
    fast = cv2.FastFeatureDetector.create(FAST_THRESHOLD)
    return {
        "good_features": lambda: cv2.goodFeaturesToTrack(
            picture, 0, QUALITY_LEVEL, MIN_DISTANCE_PX
        ).reshape(-1, 2),
        "fast": lambda: [[*corner.pt, corner.response] for corner in fast.detect(picture)],
    }
