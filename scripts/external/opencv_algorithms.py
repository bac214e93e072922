"""OpenCV's corners: ``python -m opencv_algorithms NAME``; ``opencv.toml`` has the parameters.

All see 8 bits of grey, as encoded. OpenCV's coordinates are ours: (0, 0) is the centre of the first
pixel; `lsd` says where they are not. Detectors are shown the region and 16 px around it.

harris
    ``cornerHarris``, as OpenCV's tutorial has it: what exceeds a share of the largest response and
    equals its dilation by 3 x 3 px. The block is 3 px wide, not the tutorial's 2, whose window lies
    half a pixel to the left of and above the pixel that its response is written to.
good_features
    ``goodFeaturesToTrackWithQuality``, as many corners as there are; the quality is the response.
fast
    ``FastFeatureDetector``, FAST-9 with non-maximum suppression; the score is the response. Of
    neighbours with one score none is a corner: a drawn square without any blur has none.
lsd
    ``createLineSegmentDetector`` with its own parameters but for the scale; OpenCV finds no corners
    by it. Where two segments of at least `min_length_px` meet at `min_angle_deg` or more, the point
    in which their lines intersect is a corner, if it is no farther than `gap_px` from an end of
    each. The shorter segment's length is the response; of corners nearer than `merge_px` to each
    other the strongest stays.

    Its segments lie 0.5 / scale - 0.5 px too far to the left and to the top: the detector goes back
    from its reduced image by a division alone. Measured on edges drawn by area in 24 directions,
    images of 200, 201 and 203 px, OpenCV 5.0.0: -0.500 (scale 0.5), -0.126 (0.8), -0.053 (0.9) and
    0.000 px (1), each +- 0.002 px. It is added here.
corner_sub_pix
    ``cornerSubPix`` of the seeds as float32, to the bit what that returns; without a dead zone.
    It does not say which corners it gave up and left at their seeds: they count as refined. Seeds
    outside the image, with which it refuses all others, too, are declined.
"""

import sys

import cv2
import numpy as np
from cornerbench import Corners, serve
from regions import in_region

REACH_PX = 16


def harris(image, *, block_px, aperture_px, k, threshold_rel):
    """Find maxima of Harris's response."""
    response = cv2.cornerHarris(image, block_px, aperture_px, k)
    is_maximum = response == cv2.dilate(response, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero(is_maximum & (response > threshold_rel * response.max()))
    return np.column_stack([columns, rows]), response[rows, columns]


def good_features(image, *, quality_level, min_distance_px, block_px):
    """Find maxima of the smaller eigenvalue."""
    # OpenCV's types forget that a mask may be None.
    points, qualities = cv2.goodFeaturesToTrackWithQuality(  # pyright: ignore[reportCallIssue]
        image,
        0,
        quality_level,
        min_distance_px,
        None,  # pyright: ignore[reportArgumentType]
        blockSize=block_px,
    )
    return ([], []) if points is None else (points, qualities)


def fast(image, *, threshold_dn):
    """Find pixels on whose circle nine in a row are brighter or darker."""
    found = cv2.FastFeatureDetector.create(threshold_dn).detect(image)
    return cv2.KeyPoint.convert(found), [corner.response for corner in found]


def lsd(image, *, scale, min_length_px, min_angle_deg, gap_px, merge_px):
    """Find intersections of neighbouring line segments."""
    found = cv2.createLineSegmentDetector(scale=scale).detect(image)[0]
    if found is None:
        return [], []
    segments = found.reshape(-1, 2, 2).astype(np.float64) + (0.5 / scale - 0.5)
    along = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    is_long = lengths >= min_length_px
    ends = segments[is_long].reshape(-1, 2)
    # By end, as are the points: two of each segment.
    lengths = np.repeat(lengths[is_long], 2)
    along = np.repeat(along[is_long], 2, axis=0) / lengths[:, None]

    a, b = np.triu_indices(len(ends), 1)
    is_pair = np.hypot(*(ends[b] - ends[a]).T) <= 2.0 * gap_px
    a, b = a[is_pair], b[is_pair]
    sine = _cross(along[a], along[b])
    # The ends of one segment are left out thereby, too.
    is_pair = np.abs(sine) >= np.sin(np.deg2rad(min_angle_deg))
    a, b, sine = a[is_pair], b[is_pair], sine[is_pair]
    between = ends[b] - ends[a]
    from_a_px, from_b_px = _cross(between, along[b]) / sine, _cross(between, along[a]) / sine
    meet = (np.abs(from_a_px) <= gap_px) & (np.abs(from_b_px) <= gap_px)
    points = (ends[a] + from_a_px[:, None] * along[a])[meet]
    responses = np.minimum(lengths[a], lengths[b])[meet]

    kept = []
    for place in np.argsort(-responses, kind="stable"):
        if (np.hypot(*(points[kept] - points[place]).T) >= merge_px).all():
            kept.append(place)
    return points[kept], responses[kept]


def _cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def corner_sub_pix(exposure, seeds, *, half_window_px, iterations, epsilon_px):
    """Refine by OpenCV's own function."""
    height, width = exposure.image.shape
    points = seeds.astype(np.float32)
    inside = ((points >= 0.0) & (points < (width, height))).all(axis=1)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, iterations, epsilon_px)
    window = (half_window_px, half_window_px)
    if inside.any():
        refined = cv2.cornerSubPix(exposure.image, points[inside], window, (-1, -1), criteria)
        points[inside] = refined.reshape(-1, 2)
    return Corners(
        points=[point if is_in else None for point, is_in in zip(points, inside, strict=True)],
        statuses=["ok" if is_in else "out_of_bounds" for is_in in inside],
    )


def main():
    """Serve the algorithm of the name given."""
    (name,) = sys.argv[1:]
    cv2.setNumThreads(1)
    functions = {
        "harris": {"detect": in_region(harris, REACH_PX)},
        "good_features": {"detect": in_region(good_features, REACH_PX)},
        "fast": {"detect": in_region(fast, REACH_PX)},
        "lsd": {"detect": in_region(lsd, REACH_PX)},
        "corner_sub_pix": {"refine": corner_sub_pix},
    }
    version = cv2.__version__
    serve(version=version, libraries={"opencv": version}, **functions[name])


if __name__ == "__main__":
    main()
