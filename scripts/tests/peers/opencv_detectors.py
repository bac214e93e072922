"""OpenCV's detectors on one grey picture, and how long they take on one core.

`python opencv_detectors.py PICTURE.png OUT REPEATS` writes `harris.f32`, `harris_float.f32` (of the
picture as floats), `min_eigenvalue.f32` into the folder OUT, and prints one JSON object: the points
of `goodFeaturesToTrack` in their order, those of FAST-9 with their scores, and the medians of the
times [s].
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

K = 0.04
QUALITY_LEVEL = 0.01
MIN_DISTANCE_PX = 3.0
FAST_THRESHOLD = 20


def gaussian_harris(picture):
    """Return Harris's response by central differences and a Gaussian window, of OpenCV's parts."""
    difference = np.array([[-0.5, 0.0, 0.5]])
    one = np.array([[1.0]])
    border = cv2.BORDER_REPLICATE
    x = cv2.sepFilter2D(picture, cv2.CV_32F, difference, one, borderType=border)
    y = cv2.sepFilter2D(picture, cv2.CV_32F, one, difference, borderType=border)
    a, b, c = (cv2.GaussianBlur(p, (11, 11), 1.5, borderType=border) for p in (x * x, y * y, x * y))
    return a * b - c * c - K * (a + b) ** 2


def median_s(function, repeats):
    """Return the median of the times that a call takes [s]."""
    took_s = []
    for _ in range(repeats):
        begun_s = time.perf_counter()
        function()
        took_s.append(time.perf_counter() - begun_s)
    return float(np.median(took_s))


def main():
    """Detect."""
    cv2.setNumThreads(1)
    picture_file, folder, repeats = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    picture = cv2.imread(str(picture_file), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        sys.exit(f"{picture_file}: no picture")
    floats = picture.astype(np.float32)
    calls = {
        "harris": lambda: cv2.cornerHarris(picture, 3, 3, K),
        "harris_float": lambda: cv2.cornerHarris(floats, 3, 3, K),
        "min_eigenvalue": lambda: cv2.cornerMinEigenVal(picture, 3),
        "gaussian_harris": lambda: gaussian_harris(picture),
    }
    for name, call in calls.items():
        call().astype("<f4").tofile(folder / f"{name}.f32")
    calls["good_features"] = lambda: cv2.goodFeaturesToTrack(
        picture, 0, QUALITY_LEVEL, MIN_DISTANCE_PX
    )
    points = calls["good_features"]().reshape(-1, 2)
    fast = cv2.FastFeatureDetector.create(FAST_THRESHOLD)
    calls["fast"] = lambda: fast.detect(picture)
    corners = [[*corner.pt, corner.response] for corner in calls["fast"]()]
    took_s = {name: median_s(call, repeats) for name, call in calls.items()}
    print(json.dumps({"points": points.tolist(), "fast": corners, "took_s": took_s}))


main()
