"""kornia's corners: ``python -m kornia_algorithms NAME``; ``kornia.toml`` has the parameters.

Both see 8 bits of grey, as encoded, and of the image the region and 16 px around it. The centre of
the first pixel is (0, 0), as ours is.

harris, gftt
    ``harris_response`` or ``gftt_response``: slopes by Sobel's filter, a Gaussian window of 1 px.
    ``nms2d`` finds what exceeds all others in the square of `radius_px`; of these count the ones
    that exceed a share of the largest response. ``conv_quad_interp3d`` moves them to the tops of
    paraboloids. It is made for stacks of scales, and kornia has none for one image: the response
    lies between two layers of zeros here, so that scale has no slope, and nothing in common with x
    and y.
"""

import sys
from functools import partial

import kornia  # pyright: ignore[reportMissingImports]
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from cornerbench import serve
from kornia.geometry import subpix  # pyright: ignore[reportMissingImports]
from regions import in_region

REACH_PX = 16
FILTER_PX = 4
"""Half the width of the widest filter, and one more [px]."""


def detect(response_of, image, *, threshold_rel, radius_px, **options):
    """Find maxima of a response, between pixels."""
    # kornia's filters mirror the image at its borders, and cannot mirror more than there is.
    if min(image.shape) <= FILTER_PX:
        return np.empty((0, 2)), np.empty(0)
    with torch.inference_mode():
        response = response_of(torch.from_numpy(image.astype(np.float32))[None, None], **options)
        side = 2 * radius_px + 1
        is_corner = subpix.nms2d(response, (side, side), mask_only=True)
        is_corner &= response > threshold_rel * response.max()
        places, tops = subpix.conv_quad_interp3d(
            _between_zeros(response),
            precomputed_nms_mask=_between_zeros(is_corner),
            allow_scale_steps=False,
        )
        rows, columns = torch.nonzero(is_corner[0, 0], as_tuple=True)
        # Of each voxel scale, x, y; the image is the middle layer.
        points = places[0, 0, 1:, 1, rows, columns].T
        return points.numpy(), tops[0, 0, 1, rows, columns].numpy()


def _between_zeros(image):
    nothing = torch.zeros_like(image)
    return torch.stack([nothing, image, nothing], dim=2)


def main():
    """Serve the algorithm of the name given."""
    (name,) = sys.argv[1:]
    torch.set_num_threads(1)
    responses = {"harris": kornia.feature.harris_response, "gftt": kornia.feature.gftt_response}
    serve(
        version=kornia.__version__,
        libraries={"kornia": kornia.__version__, "torch": torch.__version__},
        detect=in_region(partial(detect, responses[name]), REACH_PX),
    )


if __name__ == "__main__":
    main()
