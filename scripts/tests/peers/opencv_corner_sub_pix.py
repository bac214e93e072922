"""`cv2.cornerSubPix` on one grey picture, and how long it takes in one thread.

`python opencv_corner_sub_pix.py PICTURE POINTS REPEATS HALF_WINDOW...` reads points from a file of
pairs of float32 numbers. It prints one JSON object: OpenCV's `version` and, by half window,
`points`, refined in at most 40 iterations or to 1e-3 px, and `took_s`, the times of so many calls.
"""

import json
import sys
from functools import partial

import cv2
import numpy as np
from clock import times_s

CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)


def main():
    """Refine."""
    picture_file, points, repeats, *half_windows = sys.argv[1:]
    cv2.setNumThreads(1)
    picture = cv2.imread(picture_file, cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise SystemExit(f"{picture_file}: not a picture")
    seeds = np.fromfile(points, "<f4").reshape(-1, 1, 2)

    def refined(half_window):
        window = (half_window, half_window)
        return cv2.cornerSubPix(picture, seeds.copy(), window, (-1, -1), CRITERIA)

    said = {
        half_window: {
            "points": refined(int(half_window)).reshape(-1, 2).tolist(),
            "took_s": times_s(partial(refined, int(half_window)), int(repeats)),
        }
        for half_window in half_windows
    }
    print(json.dumps({"version": cv2.__version__, "windows": said}))


main()
