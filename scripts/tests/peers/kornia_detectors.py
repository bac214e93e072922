"""kornia's detectors; `detectors.py` says what the functions are.

Slopes are Sobel's, in our unit; the window is a Gaussian of 1 px and of 7 samples. The picture
continues by its border's pixels, the products are reflected.
"""

import kornia  # pyright: ignore[reportMissingImports]
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from kornia.geometry import subpix  # pyright: ignore[reportMissingImports]

VERSION = kornia.__version__
K = 0.04
RADIUS_PX = 2
THRESHOLD_REL = 0.01

torch.set_num_threads(1)


def tensor(picture):
    """Return the picture as kornia takes it: one of one channel."""
    return torch.from_numpy(picture.astype(np.float32))[None, None]


def responses(picture):
    """Return Harris's response and Shi and Tomasi's."""
    image = tensor(picture)

    def of(response, **options):
        def call():
            with torch.inference_mode():
                return response(image, **options)[0, 0].numpy()

        return call, 1.0

    return {
        "harris": of(kornia.feature.harris_response, k=K),
        "shi_tomasi": of(kornia.feature.gftt_response),
    }


def points(picture):
    """Return the maxima of the Hessian's determinant in squares."""
    image = tensor(picture)
    side = 2 * RADIUS_PX + 1

    def hessian_peaks():
        with torch.inference_mode():
            response = kornia.feature.hessian_response(image)
            peaks = subpix.nms2d(response, (side, side))[0, 0]
            found = torch.nonzero(peaks > THRESHOLD_REL * response.max())
            strongest_first = peaks[found[:, 0], found[:, 1]].argsort(descending=True)
            return found[strongest_first].flip(1).numpy()

    return {"hessian_peaks": hessian_peaks}
