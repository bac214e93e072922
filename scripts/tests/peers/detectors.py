"""A library's detectors on one grey picture, and how long they take.

`python detectors.py LIBRARY PICTURE.png OUT REPEATS` writes the library's responses into the
folder OUT, each as rows of float32 in the file NAME.f32, and prints one JSON object: the library's
`version`; the `points` of each of its detectors of points; `took_s`, by name the `least` time, the
lower `quartile` and the `median` of so many calls [s].

LIBRARY is the name of a module beside this one less `_detectors`: opencv, scikit_image or kornia.
Each uses one thread, as OMP_NUM_THREADS and the like have to say, too, and has, by name,

- `responses(picture)`: calls that return a response, and what makes its unit ours, by which it is
  multiplied before it is written;
- `points(picture)`: calls that return corners, of each x and y [px], and what else is known.

Where the library is not installed this ends with exit code 3.
"""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
from clock import times_s
from PIL import Image

NOT_INSTALLED = 3


def main():
    """Detect."""
    library, picture_file, folder, repeats = sys.argv[1:]
    try:
        peer = importlib.import_module(f"{library}_detectors")
    except ModuleNotFoundError as error:
        print(error, file=sys.stderr)
        sys.exit(NOT_INSTALLED)
    picture = np.array(Image.open(picture_file).convert("L"))
    responses, points = peer.responses(picture), peer.points(picture)
    # The first call of each, which is not timed, gives the answer.
    for name, (call, unit) in responses.items():
        response = np.asarray(call(), np.float64) * unit
        response.astype("<f4").tofile(Path(folder) / f"{name}.f32")
    found = {name: np.asarray(call(), np.float64).tolist() for name, call in points.items()}
    calls = {name: call for name, (call, _) in responses.items()} | points
    took_s = {name: times_s(call, int(repeats)) for name, call in calls.items()}
    print(json.dumps({"version": peer.VERSION, "points": found, "took_s": took_s}))


main()
