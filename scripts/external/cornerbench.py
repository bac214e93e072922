"""An algorithm in Python takes part in cornerbench's measurements.

::

    from cornerbench import serve

    def refine(exposure, seeds):
        return better(exposure.image, seeds)

    serve(refine=refine, version="1.0")

and ``cornerbench measure PLAN --with FILE.py``. What is said line by line is described in
``scripts/PROTOCOL.md``; this module needs numpy alone.
"""

import inspect
import json
import math
import mmap
import os
import platform
import sys
import time
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["PROTOCOL", "Corners", "Exposure", "Grasp", "GraspQuestion", "serve"]

PROTOCOL = 1
"""Version of what is said."""

_ENCODER = json.JSONEncoder(allow_nan=False, separators=(",", ":"))
_TYPES = {"uint8": np.dtype("u1"), "uint16": np.dtype("u2"), "float32": np.dtype("f4")}


def _protocol_s_own():
    """Take the two streams of the protocol: what is printed from here on goes to standard error."""
    questions = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), 0)
    sys.stdout.flush()
    os.dup2(2, 1)
    return questions, answers


# Started to be measured: what is printed while modules are loaded may not come before answers.
_STREAMS = _protocol_s_own() if "CORNERBENCH_PROGRAM" in os.environ else None


@dataclass
class Exposure:
    """A photograph, and what a user would know of it."""

    image: np.ndarray
    """Rows x columns, or these x 3 of red, green, blue; valid until the function returns."""
    bit_depth: int
    """Of the camera's samples: a digital number (DN) is full scale / (2^bit_depth - 1)."""
    curve: Any
    """From light to samples: "linear", "srgb", {"power": {"gamma"}} or {"log": {"gain"}}."""
    black_dn: float
    """The sample without light [DN]."""
    mosaic: tuple[int, int] | None = None
    """Where the first pixel lies in a mosaic red, green / green, blue that colours were made of."""
    noise: dict | None = None
    """The sensor's data sheet, and light of full scale per raw digital number of each channel."""
    camera: dict | None = None
    """Intrinsics, where ``needs`` says intrinsics: fx_px, fy_px, cx_px, cy_px, distortion."""
    object_size_m: list | None = None
    """The target's edge lengths, where ``needs`` says object_size."""
    region: tuple[int, int, int, int] | None = None
    """Where to find corners: first column and row, those behind the last; None: everywhere."""


@dataclass
class GraspQuestion:
    """A face of the target, and what the range sensor saw."""

    face: np.ndarray
    """Its four corners in the image [px], clockwise as seen."""
    camera: dict
    """The colour camera's intrinsics."""
    world_from_camera: np.ndarray
    """3 x 4: rotation and place [m]."""
    range_points_m: np.ndarray
    """Rows x columns x 3: each cell's point in the range sensor's frame; NaN where it saw none."""
    range_camera: dict
    """The range sensor's intrinsics."""
    world_from_range: np.ndarray
    """3 x 4: rotation and place [m]."""


@dataclass
class Corners:
    """Refined corners, with more than their places."""

    points: Any
    """x, y of each seed [px]; None of one that is declined."""
    statuses: list | None = None
    """Of each "ok", "max_iterations", "reverted", "diverged", "singular", "out_of_bounds",
    "not_applicable" or "false_corner"."""
    covariances_px2: Any = None
    """2 x 2 of each, or None."""
    iterations: list | None = None
    """Of each."""


@dataclass
class Grasp:
    """A grasp, with more than its point. Directions are in the camera frame."""

    point: Any
    """The image point that was looked up: x, y [px]."""
    point_in_camera_m: Any
    """The grasp point [m]."""
    approach: Any = None
    """Out of the face: the gripper comes against it. Only with jaw and opening_m."""
    jaw: Any = None
    """Along which the jaws move."""
    opening_m: float | None = None
    """How far apart they are when they touch."""
    covariance_m2: Any = None
    """3 x 3, of the grasp point."""


@dataclass
class _Pictures:
    """The file in which samples are, mapped once."""

    path: str = ""
    mapped: mmap.mmap | None = None

    def array(self, image: dict) -> np.ndarray:
        """Return the samples, not copied."""
        dtype = _TYPES[image["type"]]
        count = image["height"] * image["width"] * image["channels"]
        if (
            self.mapped is None
            or self.path != image["file"]
            or len(self.mapped) < count * dtype.itemsize
        ):
            with open(image["file"], "rb") as file:
                self.mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            self.path = image["file"]
        samples = np.frombuffer(self.mapped, dtype, count)
        shape = (image["height"], image["width"], image["channels"])
        return samples.reshape(shape if image["channels"] > 1 else shape[:2])


def serve(*, version, detect=None, refine=None, grasp=None, needs=None, libraries=None):
    """Answer questions until there are no more.

    Whatever is printed meanwhile goes to standard error. Functions are timed by themselves; one
    that raises an exception has failed on this exposure, and is asked about the next one.

    Parameters
    ----------
    version
        What the algorithm is, in every row: change it when its answers change. Or a function,
        ``version(**parameters)``, called once before all questions, that returns it: where answers
        depend on a file that a parameter names, or something is to be loaded that takes long.
    detect
        ``detect(exposure, **parameters)`` returns points, x and y of each, strongest first; or
        points and responses.
    refine
        ``refine(exposure, seeds, **parameters)`` returns a point for each seed, x and y, in their
        order, or ``Corners``. Seeds are an array of n x 2, float64.
    grasp
        ``grasp(question, **parameters)`` of a ``GraspQuestion`` returns the image point that was
        looked up and the grasp point in the camera frame [m]; or a ``Grasp``, or None.
    needs
        What the image is: {"channels": "grey" | "rgb", "encoding": "encoded" | "linear", "type":
        "uint8" | "uint16" | "float32", "intrinsics": False, "object_size": False}.
    libraries
        Their versions by name, of all that the answers depend on; Python's and numpy's are added.
    """
    functions = {"detect": detect, "refine": refine, "grasp": grasp}
    functions = {task: function for task, function in functions.items() if function is not None}
    if not functions:
        raise TypeError("serve needs detect=, refine= or grasp=")
    if sys.stdin is not None and sys.stdin.isatty():
        sys.exit(f"to measure this: cornerbench measure PLAN --with {sys.argv[0]}")
    questions, answers = _STREAMS or _protocol_s_own()

    def say(answer):
        answers.write(_ENCODER.encode(answer).encode() + b"\n")
        answers.flush()

    greeting = json.loads(questions.readline() or b"{}")
    parameters = greeting.get("parameters", {})
    for task, function in functions.items():
        _check_parameters(task, function, parameters)
    ready = {
        "protocol": PROTOCOL,
        "version": str(version(**parameters) if callable(version) else version),
        "libraries": {
            **(libraries or {}),
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "does": list(functions),
    }
    if needs is not None:
        ready["needs"] = needs
    say(ready)
    pictures = _Pictures()
    for line in questions:
        question = json.loads(line)
        try:
            say({"id": question["id"], **_answer(functions, question, pictures, parameters)})
        except Exception as error:
            traceback.print_exc()
            said = "".join(traceback.format_exception_only(error)).strip()
            say({"id": question["id"], "error": f"{said} {_place(error)}".strip()})


def _check_parameters(task, function, parameters):
    """End where the function does not take what it will be given: once, not at every photograph."""
    given = ["exposure", "seeds"] if task == "refine" else ["exposure"]
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # Of what is compiled nothing is known.
        return
    try:
        signature.bind(*given, **parameters)
    except TypeError as error:
        said = ", ".join([*given, *(f"{name}={value!r}" for name, value in parameters.items())])
        sys.exit(f"{task}({said}): {error}")


def _place(error):
    """Where in the program's own code an exception was raised, not in a library of its."""
    frames = traceback.extract_tb(error.__traceback__)
    program = os.path.abspath(getattr(sys.modules["__main__"], "__file__", None) or __file__)
    own = [frame for frame in frames if os.path.abspath(frame.filename) == program]
    return f"({os.path.basename(own[-1].filename)}:{own[-1].lineno})" if own else ""


def _answer(functions, question, pictures, parameters):
    task = question["task"]
    if task not in functions:
        raise ValueError(f"does not {task}")
    function = functions[task]
    is_grasp = task == "grasp"
    arguments: list[Any] = [
        _grasp_question(question) if is_grasp else _exposure(question, pictures)
    ]
    if task == "refine":
        arguments.append(np.array(question["seeds"], np.float64).reshape(-1, 2))
    begun = time.perf_counter_ns()
    answer = function(*arguments, **parameters)
    took_us = 1e-3 * (time.perf_counter_ns() - begun)
    shape = {"detect": _detected, "refine": _refined, "grasp": _grasped}[task]
    return {"took_us": took_us, **shape(answer)}


def _exposure(question, pictures):
    image = question["image"]
    mosaic, region = image.get("mosaic"), question.get("region")
    return Exposure(
        image=pictures.array(image),
        bit_depth=image["bit_depth"],
        curve=image["curve"],
        black_dn=image["black_dn"],
        mosaic=tuple(mosaic) if mosaic else None,
        noise=image.get("noise"),
        camera=question.get("camera"),
        object_size_m=question.get("object_size_m"),
        region=tuple(region) if region else None,
    )


def _grasp_question(question):
    ranges = question["range"]
    cells = [[np.nan] * 3 if point is None else point for point in ranges["points_m"]]
    size = (ranges["camera"]["height"], ranges["camera"]["width"], 3)
    return GraspQuestion(
        face=np.array(question["face"], np.float64),
        camera=question["camera"],
        world_from_camera=np.array(question["world_from_camera"], np.float64),
        range_points_m=np.array(cells, np.float64).reshape(size),
        range_camera=ranges["camera"],
        world_from_range=np.array(ranges["world_from_range"], np.float64),
    )


def _points(points):
    """Pairs of finite numbers, or None where a point is None."""
    if isinstance(points, np.ndarray) and points.dtype != object:
        array = np.asarray(points, np.float64)
        # OpenCV has n x 1 x 2.
        if array.size and not (array.shape[-1] == 2 and array.ndim in (2, 3)):
            raise ValueError(f"points must be n x 2, found {points.shape}")
        array = array.reshape(-1, 2)
        # A sum is finite where all are, unless they are absurdly large: then they are looked at.
        if not math.isfinite(array.sum()) and not np.isfinite(array).all():
            place = int(np.argmin(np.isfinite(array).all(axis=1)))
            raise ValueError(
                f"point {place} is {array[place].tolist()}: say None to decline a corner"
            )
        return array.tolist()
    return [None if point is None else _pair(place, point) for place, point in enumerate(points)]


def _pair(place, point):
    pair = np.asarray(point, np.float64).reshape(-1).tolist()
    if len(pair) != 2:
        raise ValueError(f"point {place} must be x and y, found {point!r}")
    if not (math.isfinite(pair[0]) and math.isfinite(pair[1])):
        raise ValueError(f"point {place} is {pair}: say None to decline a corner")
    return pair


def _detected(answer):
    if not isinstance(answer, tuple):
        return {"points": _points(answer)}
    if len(answer) != 2:
        raise ValueError(f"detect must return points, or points and responses: {len(answer)} found")
    points, responses = _points(answer[0]), np.asarray(answer[1], np.float64).reshape(-1)
    if len(points) != len(responses):
        raise ValueError(f"{len(responses)} responses for {len(points)} points")
    if not np.isfinite(responses).all():
        raise ValueError(f"response {int(np.argmin(np.isfinite(responses)))} is not finite")
    return {"points": points, "responses": responses.tolist()}


def _refined(answer):
    if not isinstance(answer, Corners):
        return {"points": _points(answer)}
    said: dict[str, Any] = {"points": _points(answer.points)}
    if answer.statuses is not None:
        said["statuses"] = [str(status) for status in answer.statuses]
    if answer.covariances_px2 is not None:
        said["covariances_px2"] = [
            None
            if covariance is None
            else [float(covariance[0][0]), float(covariance[0][1]), float(covariance[1][1])]
            for covariance in answer.covariances_px2
        ]
    if answer.iterations is not None:
        said["iterations"] = [int(count) for count in answer.iterations]
    return said


def _grasped(answer):
    if answer is None:
        return {}
    if not isinstance(answer, Grasp):
        point, point_in_camera_m = answer
        answer = Grasp(point, point_in_camera_m)
    said: dict[str, Any] = {
        "point": _numbers(answer.point),
        "point_in_camera_m": _numbers(answer.point_in_camera_m),
    }
    for name in ("approach", "jaw"):
        if getattr(answer, name) is not None:
            said[name] = _numbers(getattr(answer, name))
    if answer.opening_m is not None:
        said["opening_m"] = float(answer.opening_m)
    if answer.covariance_m2 is not None:
        covariance = np.asarray(answer.covariance_m2, np.float64)
        said["covariance_m2"] = covariance[np.triu_indices(3)].tolist()
    return said


def _numbers(values):
    return [float(value) for value in values]
