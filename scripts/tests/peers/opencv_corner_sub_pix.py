"""Refine points of a picture by `cv2.cornerSubPix` and print one JSON pair a line."""

from __future__ import annotations

import json
import sys

import cv2
import numpy as np

HALF_WINDOW_PX = 5
MAX_ITERATIONS = 40
EPSILON_PX = 1e-3


def main() -> int:
    """Read a picture and a file of points from the command line, print the refined points."""
    picture, points = sys.argv[1:]
    colours = cv2.imread(picture)
    if colours is None:
        raise SystemExit(f"{picture}: not a picture")
    blue, green, red = np.moveaxis(colours.astype(np.float32), 2, 0)
    luma = np.float32(0.299) * red + np.float32(0.587) * green + np.float32(0.114) * blue
    grey = np.floor(luma + np.float32(0.5))  # halves go up, as in the harness
    seeds = np.loadtxt(points, delimiter=",", dtype=np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, MAX_ITERATIONS, EPSILON_PX)
    window = (HALF_WINDOW_PX, HALF_WINDOW_PX)
    refined = cv2.cornerSubPix(grey.astype(np.uint8), seeds.copy(), window, (-1, -1), criteria)
    for x, y in refined.reshape(-1, 2).tolist():
        print(json.dumps([x, y]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
