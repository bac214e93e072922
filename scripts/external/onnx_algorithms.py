"""Learned detectors through onnxruntime, weights not included: ``python -m onnx_algorithms NAME``.

``onnx.toml`` says how to name a model. It has one input, 1 x 1 x H x W, float32, the grey values as
encoded from 0 to 1. What its outputs are is told by their shapes, whatever their names; others,
descriptors say, are not looked at.

1 x 65 x H/8 x W/8
    Logits of cells of 8 x 8 px, row by row, and of "no corner", as SuperPoint has them: the softmax
    over all 65, less the last, is the heat map.
1 x 1 x H x W
    The heat map itself, as it is.
1 x 2 x H x W
    Of `offset` alone: by how much a corner lies right of and below its pixel's centre [px].

heatmap
    Corners are the pixels that no other one in the square of `radius_px` exceeds, of more heat than
    `threshold`; equals all count. The heat is the response. (0, 0) is the first pixel's centre.
offset
    These, each moved by the offset at its pixel.

The model sees the whole image whatever region is asked for: how far around a corner it looks is not
known here. Below and at the right the image is continued by its last pixels, to multiples of 8 or
to the size that the model has fixed. The version is the beginning of the file's SHA-256; weights in
a second file are not part of it. onnxruntime computes in one thread of the processor.
"""

import hashlib
import sys
from pathlib import Path

import numpy as np
import onnxruntime
from cornerbench import serve
from scipy.ndimage import maximum_filter

CELL_PX = 8


class Detector:
    """A model and what is made of its outputs."""

    def __init__(self, has_offsets):
        self.has_offsets = has_offsets

    def load(self, *, model, **_):
        """Open the model, try it on an empty image, and return its version."""
        if not model:
            sys.exit(
                "parameter model is empty: copy this table from scripts/external/onnx.toml into a "
                'file of your own, say parameters.model = "PATH.onnx" there, relative to that '
                "file, and measure --with that file"
            )
        if not Path(model).is_file():
            sys.exit(f"parameter model: {Path(model).absolute()} is not there")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self.session = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
            self.size = self._size()
            self._run(np.zeros([CELL_PX if side is None else side for side in self.size], "f4"))
        except Exception as error:
            # In one line, of which the harness shows the last.
            sys.exit(f"{model}: {' '.join(str(error).split())}")
        return hashlib.sha256(Path(model).read_bytes()).hexdigest()[:12]

    def _size(self):
        """Height and width that the model has fixed, None where it takes any."""
        inputs = self.session.get_inputs()
        wanted = "must have one input, 1 x 1 x H x W of float32"
        if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].type != "tensor(float)":
            found = ", ".join(f"{one.name} {one.shape} {one.type}" for one in inputs)
            raise ValueError(f"{wanted}, found {found}")
        # Names or None stand for any number.
        count, channels, *size = (
            side if isinstance(side, int) else None for side in inputs[0].shape
        )
        if count not in (None, 1) or channels not in (None, 1):
            raise ValueError(f"{wanted}, found {inputs[0].shape}")
        return size

    def _run(self, image):
        """Return the heat map, and the offsets or None."""
        height, width = image.shape
        padded = []
        for side, fixed in zip(image.shape, self.size, strict=True):
            if fixed is not None and side > fixed:
                raise ValueError(
                    f"the model takes images of {self.size[0]} x {self.size[1]} px (height x "
                    f"width), this one is {height} x {width}"
                )
            padded.append(-(-side // CELL_PX) * CELL_PX if fixed is None else fixed)
        grown = [(0, to - side) for side, to in zip(image.shape, padded, strict=True)]
        fed = {self.session.get_inputs()[0].name: np.pad(image, grown, mode="edge")[None, None]}
        outputs = [np.asarray(output) for output in self.session.run(None, fed)]
        cells = [side // CELL_PX for side in padded]
        by_shape = {output.shape: output[0] for output in reversed(outputs)}
        found = ", ".join(f"{output.shape}" for output in outputs)
        of_logits, of_heat = (1, CELL_PX**2 + 1, *cells), (1, 1, *padded)
        of_offsets = (1, 2, *padded)
        if of_logits in by_shape:
            heat = _heat(by_shape[of_logits])
        elif of_heat in by_shape:
            heat = by_shape[of_heat][0]
        else:
            raise ValueError(
                f"of an input of {of_heat} no output is a heat map, {of_heat}, or logits of cells, "
                f"{of_logits}; found {found}"
            )
        if self.has_offsets and of_offsets not in by_shape:
            raise ValueError(f"no output is of offsets, {of_offsets}; found {found}")
        return heat[:height, :width], by_shape[of_offsets] if self.has_offsets else None

    def detect(self, exposure, *, threshold, radius_px, **_):
        """Find the heat map's maxima."""
        heat, offsets = self._run(exposure.image)
        largest = maximum_filter(heat, 2 * radius_px + 1, mode="nearest")
        rows, columns = np.nonzero((heat == largest) & (heat > threshold))
        points = np.column_stack([columns, rows]).astype(np.float64)
        if offsets is not None:
            points += offsets[:, rows, columns].T
        order = np.argsort(-heat[rows, columns], kind="stable")
        return points[order], heat[rows, columns][order]


def _heat(logits):
    """Return the probability of each pixel of each cell."""
    shares = np.exp(logits - logits.max(axis=0))
    shares /= shares.sum(axis=0)
    _, rows, columns = shares.shape
    cells = shares[:-1].reshape(CELL_PX, CELL_PX, rows, columns)
    return cells.transpose(2, 0, 3, 1).reshape(rows * CELL_PX, columns * CELL_PX)


def main():
    """Serve the detector of the name given."""
    (name,) = sys.argv[1:]
    detector = Detector(has_offsets={"heatmap": False, "offset": True}[name])
    serve(
        version=detector.load,
        libraries={"onnxruntime": onnxruntime.__version__},
        detect=detector.detect,
        needs={"type": "float32"},
    )


if __name__ == "__main__":
    main()
