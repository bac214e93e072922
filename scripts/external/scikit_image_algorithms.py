"""scikit-image's corners: ``python -m scikit_image_algorithms NAME``.

``scikit_image.toml`` has the parameters. Both see 8 bits of grey, as encoded; scikit-image's
places are row and column, and the centre of the first pixel is (0, 0), as ours is. The detector
is shown the region and 16 px around it.

harris
    ``corner_harris``, then ``corner_peaks``. Beyond the image all is 0, and the step down to it
    would have the strongest response, of which the threshold is a share: responses that it reaches,
    1 + 4 sigma px from the edges, are cut off.
corner_subpix
    ``corner_subpix`` of the seeds, rounded as it takes whole pixels only. What it declines, NaN, as
    neither two edges nor a dot are there, is not_applicable. Seeds whose window and the pixel of
    Sobel's filter around it leave the image are declined: they would be refined on its zeros.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
# scikit-image says no types; what is inferred from its defaults is too narrow.

import sys

import numpy as np
import skimage
from cornerbench import Corners, serve
from regions import in_region

# By name: the modules would be loaded during the first measured call otherwise.
from skimage.feature import corner_harris, corner_peaks
from skimage.feature import corner_subpix as refined_corners

REACH_PX = 16


def harris(image, *, k, sigma_px, threshold_rel, min_distance_px):
    """Find maxima of Harris's response."""
    # The filter's Gaussian ends at 4 sigma, rounded.
    edge_px = 1 + int(4.0 * sigma_px + 0.5)
    if min(image.shape) <= 2 * edge_px:
        return [], []
    response = corner_harris(image, k=k, sigma=sigma_px)[edge_px:-edge_px, edge_px:-edge_px]
    peaks = corner_peaks(
        response, min_distance=min_distance_px, threshold_rel=threshold_rel, exclude_border=False
    )
    return peaks[:, ::-1] + edge_px, response[peaks[:, 0], peaks[:, 1]]


def corner_subpix(exposure, seeds, *, window_px, alpha):
    """Refine by Foerstner's normal equations, of edges or of a dot."""
    height, width = exposure.image.shape
    whole = np.rint(seeds).astype(int)
    reach_px = window_px // 2 + 1
    inside = (whole >= reach_px) & (whole < (width - reach_px, height - reach_px))
    inside = inside.all(axis=1)
    refined = np.full(seeds.shape, np.nan)
    refined[inside] = refined_corners(
        exposure.image, whole[inside, ::-1], window_size=window_px, alpha=alpha
    )[:, ::-1]
    found = np.isfinite(refined).all(axis=1)
    declined = np.where(inside, "not_applicable", "out_of_bounds")
    return Corners(
        points=[point if is_one else None for point, is_one in zip(refined, found, strict=True)],
        statuses=np.where(found, "ok", declined).tolist(),
    )


def main():
    """Serve the algorithm of the name given."""
    (name,) = sys.argv[1:]
    functions = {
        "harris": {"detect": in_region(harris, REACH_PX)},
        "corner_subpix": {"refine": corner_subpix},
    }
    version = skimage.__version__
    serve(version=version, libraries={"scikit-image": version}, **functions[name])


if __name__ == "__main__":
    main()
