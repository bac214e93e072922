"""Algorithms in Python answer as they are asked to, adapters as their libraries do."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

EXTERNAL = Path(__file__).parents[1] / "external"
TABLES = {
    name: table
    for file in sorted(EXTERNAL.glob("*.toml"))
    for name, table in tomllib.loads(file.read_text()).items()
    # Programs that are compiled are tried where they are.
    if table["command"][0].startswith("{python")
}
PACKAGES = {"opencv": "cv2", "scikit_image": "skimage", "kornia": "kornia", "onnx": "onnxruntime"}
DETECTORS = [
    name
    for name, table in TABLES.items()
    if table["does"] == "detect" and not name.startswith("onnx")
]
FULL_SCALE = {"uint8": (np.uint8, 1.0), "float32": (np.float32, 1.0 / 255.0)}


class Algorithm:
    """A program that was greeted, and is asked as the harness asks."""

    def __init__(self, folder: Path, command: list[str], parameters: dict[str, Any]):
        self.file = folder / "image"
        self.process = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(EXTERNAL), "OMP_NUM_THREADS": "1"},
        )
        self.ready = self.say({"protocol": 1, "parameters": parameters})
        self.asked = 0

    def say(self, line: dict[str, Any]) -> dict[str, Any]:
        """Return the line that answers a line."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(line) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        assert answer, f"it ended: {self.process.communicate()[1]}"
        # As the harness: NaN is no JSON.
        return json.loads(answer, parse_constant=lambda word: pytest.fail(f"{word} in {answer}"))

    def ask(self, picture: np.ndarray, **question: Any) -> dict[str, Any]:
        """Return the answer to a question about 8 bits of grey."""
        sample = self.ready.get("needs", {}).get("type", "uint8")
        dtype, scale = FULL_SCALE[sample]
        self.file.write_bytes((picture * dtype(scale)).astype(dtype).tobytes())
        height, width = picture.shape
        image = {"file": str(self.file), "width": width, "height": height, "channels": 1}
        image |= {"type": sample, "encoding": "encoded", "bit_depth": 8, "curve": "linear"}
        self.asked += 1
        task = "refine" if "seeds" in question else "detect"
        line = {"id": self.asked, "task": task, "image": {**image, "black_dn": 0.0}, **question}
        answer = self.say(line)
        assert answer.pop("id") == self.asked
        return answer

    def end(self) -> str:
        """Return what it said to standard error."""
        return self.process.communicate(timeout=20.0)[1]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Algorithm]]:
    started: list[Algorithm] = []

    def start_one(*command: str, **parameters: Any) -> Algorithm:
        started.append(Algorithm(tmp_path, list(command), parameters))
        return started[-1]

    yield start_one
    for algorithm in started:
        algorithm.process.kill()
        algorithm.process.communicate()


@pytest.fixture
def start_table(start: Callable[..., Algorithm]) -> Callable[..., Algorithm]:
    """Start what a table describes, some of its parameters replaced."""

    def start_one(name: str, **parameters: Any) -> Algorithm:
        pytest.importorskip(PACKAGES[name.split("-")[0]])
        python, *command = TABLES[name]["command"]
        assert python.startswith("{python:")
        return start(*command, **{**TABLES[name]["parameters"], **parameters})

    return start_one


@pytest.fixture
def start_text(start: Callable[..., Algorithm], tmp_path: Path) -> Callable[..., Algorithm]:
    """Start a program of a user's own."""

    def start_one(text: str, **parameters: Any) -> Algorithm:
        (tmp_path / "own.py").write_text(f"from cornerbench import Corners, serve\n{text}")
        return start(str(tmp_path / "own.py"), **parameters)

    return start_one


# Of rectangles: first column and row, and those behind the last.
WIDE = (30.3, 41.3, 100.7, 75.7)


def rectangle(sides: tuple[float, ...] = WIDE, size: tuple[int, int] = (120, 160)) -> np.ndarray:
    """Draw a light rectangle by area; x and y of its sides lie between pixels' centres."""
    x0, y0, x1, y1 = sides

    def covered(first: float, behind: float, count: int) -> np.ndarray:
        pixel = np.arange(count)
        return np.clip(np.minimum(pixel + 0.5, behind) - np.maximum(pixel - 0.5, first), 0.0, 1.0)

    area = covered(y0, y1, size[0])[:, None] * covered(x0, x1, size[1])
    # Without any blur FAST finds equals and, of these, none.
    return np.rint(40.0 + 160.0 * gaussian_filter(area, 0.5)).astype(np.uint8)


def corners(sides: tuple[float, ...] = WIDE) -> np.ndarray:
    x0, y0, x1, y1 = sides
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def farthest_px(points: list[list[float]], sides: tuple[float, ...] = WIDE) -> float:
    """Return the distance of that corner which is farthest from all points."""
    distances = np.linalg.norm(corners(sides)[:, None] - np.array(points)[None], axis=2)
    return float(distances.min(axis=1).max())


@pytest.mark.parametrize("name", TABLES)
def test_a_table_says_what_it_is_in_one_line_and_how_it_is_installed(name: str):
    table = TABLES[name]
    assert "\n" not in table["summary"]
    assert table["install"].startswith("cornerbench setup --")
    environment = table["command"][0]
    assert environment == f"{{python:{table['install'].rsplit('--', 1)[1]}}}"


@pytest.mark.parametrize("name", DETECTORS)
def test_a_detector_finds_the_corners_of_a_rectangle_strongest_first(name: str, start_table):
    detector = start_table(name)
    assert detector.ready["does"] == ["detect"]
    answer = detector.ask(rectangle())
    assert answer["took_us"] > 0.0
    assert np.isfinite(answer["points"]).all()
    assert len(answer["points"]) == len(answer["responses"]) <= 40
    assert answer["responses"] == sorted(answer["responses"], reverse=True)
    assert farthest_px(answer["points"]) < 1.5


@pytest.mark.parametrize("name", DETECTORS)
def test_a_detector_keeps_to_the_region_and_finds_the_same_there(name: str, start_table):
    detector = start_table(name)
    everywhere = np.array(detector.ask(rectangle())["points"])
    x0, y0, x1, y1 = region = (80, 20, 120, 60)
    found = np.array(detector.ask(rectangle(), region=region)["points"])
    inside = (everywhere >= (x0 - 0.5, y0 - 0.5)) & (everywhere < (x1 - 0.5, y1 - 0.5))
    assert len(found) == inside.all(axis=1).sum() > 0
    # A part of the image is reduced from other pixels: segments differ by some hundredths.
    same_px = 0.3 if name == "opencv-lsd" else 1e-3
    expected = everywhere[inside.all(axis=1)]
    assert np.linalg.norm(found[:, None] - expected, axis=2).min(axis=1).max() < same_px


@pytest.mark.parametrize("name", DETECTORS)
def test_a_detector_finds_nothing_in_an_even_image(name: str, start_table):
    detector = start_table(name)
    for size in ((60, 80), (8, 9), (1, 1)):
        answer = detector.ask(np.full(size, 77, np.uint8))
        assert answer.get("points") == [], answer


def test_segments_of_opencv_lie_where_they_were_drawn(start_table):
    detector = start_table("opencv-lsd")
    # If not corrected, 0.125 px too far to the top left. 5 px are 4 of the reduced image.
    offsets = []
    for step in range(8):
        moved = tuple(side + 0.625 * step for side in WIDE)
        found = np.array(detector.ask(rectangle(moved))["points"])
        assert len(found) == 4
        distances = found[:, None] - corners(moved)[None]
        nearest = np.linalg.norm(distances, axis=2).argmin(axis=1)
        offsets.append(distances[np.arange(4), nearest].mean(axis=0))
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.03


def noisy(seed: int = 1) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 3.0, rectangle().shape)
    return np.clip(rectangle() + noise, 0, 255).astype(np.uint8)


def test_corner_sub_pix_is_opencv_s_to_the_bit(start_table):
    cv2 = pytest.importorskip("cv2")
    cv2.setNumThreads(1)
    picture = noisy()
    seeds = np.random.default_rng(2).uniform((-0.4, -0.4), (159.4, 119.4), (400, 2))
    seeds = np.concatenate([corners() + 1.3, seeds[(seeds >= 0.0).all(axis=1)]])
    answer = start_table("opencv-corner_sub_pix").ask(picture, seeds=seeds.tolist())
    given = seeds.astype(np.float32).reshape(-1, 1, 2)
    expected = cv2.cornerSubPix(picture, given, (5, 5), (-1, -1), (3, 40, 1e-3)).reshape(-1, 2)
    assert answer["points"] == expected.astype(np.float64).tolist()
    assert set(answer["statuses"]) == {"ok"}
    assert np.linalg.norm(np.array(answer["points"][:4]) - corners(), axis=1).max() < 0.8


def test_a_seed_outside_the_image_is_declined_and_the_others_are_not(start_table):
    seeds = [[-0.3, 5.0], [30.0, 41.0], [160.0, 60.0], [50.0, 1e6]]
    answer = start_table("opencv-corner_sub_pix").ask(rectangle(), seeds=seeds)
    assert answer["statuses"] == ["out_of_bounds", "ok", "out_of_bounds", "out_of_bounds"]
    assert [point is None for point in answer["points"]] == [True, False, True, True]


def test_scikit_image_refines_with_x_and_y_in_order_and_says_what_it_declines(start_table):
    seeds = [*(corners() + 0.4).tolist(), [130.0, 100.0], [3.0, 60.0]]
    answer = start_table("scikit_image-corner_subpix").ask(rectangle(), seeds=seeds)
    assert answer["statuses"] == [*["ok"] * 4, "not_applicable", "out_of_bounds"]
    assert answer["points"][4:] == [None, None]
    assert np.linalg.norm(np.array(answer["points"][:4]) - corners(), axis=1).max() < 0.8


def test_scikit_image_s_answers_are_its_own(start_table):
    feature = pytest.importorskip("skimage.feature")
    picture = noisy()
    seeds = np.rint(corners())
    answer = start_table("scikit_image-corner_subpix").ask(picture, seeds=seeds.tolist())
    rows_columns = seeds[:, ::-1].astype(int)
    expected = feature.corner_subpix(picture, rows_columns, window_size=11, alpha=0.99)
    assert answer["points"] == expected[:, ::-1].tolist()


@pytest.fixture
def model(tmp_path: Path) -> Callable[..., str]:
    """Write a model: what its nodes make of its input."""
    onnx = pytest.importorskip("onnx")

    def write(*outputs: str, size: tuple[int | str, int | str] = ("H", "W")) -> str:
        helper, numbers = onnx.helper, onnx.TensorProto

        def constant(name: str, values: Any) -> Any:
            return onnx.numpy_helper.from_array(np.array(values), name)

        nodes = {
            # The image is its own heat map.
            "heat": [helper.make_node("Identity", ["image"], ["heat"])],
            "offsets": [
                helper.make_node("Mul", ["image", "nothing"], ["none"]),
                helper.make_node("Add", ["none", "moved"], ["offsets"]),
            ],
            # The pixels of each cell times 100, then one of "no corner", 50.
            "logits": [
                helper.make_node("SpaceToDepth", ["image"], ["cells"], blocksize=8),
                helper.make_node("Mul", ["cells", "hundred"], ["hot"]),
                helper.make_node("ReduceSum", ["hot", "channels"], ["sums"]),
                helper.make_node("Mul", ["sums", "zero"], ["zeros"]),
                helper.make_node("Add", ["zeros", "fifty"], ["cold"]),
                helper.make_node("Concat", ["hot", "cold"], ["logits"], axis=1),
            ],
            "halved": [helper.make_node("MaxPool", ["image"], ["halved"], kernel_shape=[1, 1])],
            "descriptors": [
                helper.make_node("SpaceToDepth", ["image"], ["descriptors"], blocksize=8)
            ],
        }
        constants = [
            constant("nothing", np.zeros((1, 2, 1, 1), np.float32)),
            constant("moved", np.array([0.25, -0.25], np.float32).reshape(1, 2, 1, 1)),
            constant("hundred", np.float32(100.0)),
            constant("zero", np.float32(0.0)),
            constant("fifty", np.float32(50.0)),
            constant("channels", np.array([1], np.int64)),
        ]
        graph = helper.make_graph(
            [node for output in outputs for node in nodes[output]],
            "tiny",
            [helper.make_tensor_value_info("image", numbers.FLOAT, [1, 1, *size])],
            [helper.make_tensor_value_info(output, numbers.FLOAT, None) for output in outputs],
            constants,
        )
        opset = [helper.make_opsetid("", 17)]
        file = tmp_path / f"{'-'.join(outputs)}.onnx"
        onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), file)
        return file.name

    return write


def spots(size: tuple[int, int] = (45, 70)) -> np.ndarray:
    """Draw two pixels: the stronger at x 61, y 13, the other at x 22, y 40."""
    picture = np.zeros(size, np.uint8)
    picture[13, 61], picture[40, 22] = 255, 204
    return picture


@pytest.mark.parametrize("output", ["heat", "logits"])
def test_a_model_s_peaks_are_found_whatever_the_size(output: str, model, start_table):
    detector = start_table("onnx-heatmap", model=model("descriptors", output))
    assert len(detector.ready["version"]) == 12
    for size in ((45, 70), (48, 72), (41, 62)):
        answer = detector.ask(spots(size))
        assert answer["points"] == [[61.0, 13.0], [22.0, 40.0]]
        assert answer["responses"] == sorted(answer["responses"], reverse=True)
    if output == "heat":
        assert answer["responses"] == pytest.approx([1.0, 0.8])


def test_logits_become_shares_of_their_cell(model, start_table):
    answer = start_table("onnx-heatmap", model=model("logits")).ask(spots())
    # In the second cell exp(80) is beside exp(50) and 63 times exp(0).
    assert answer["responses"] == pytest.approx([1.0, 1.0 / (1.0 + np.exp(-30.0))])


def test_a_model_s_offsets_move_its_peaks(model, start_table):
    answer = start_table("onnx-offset", model=model("offsets", "heat")).ask(spots())
    assert answer["points"] == [[61.25, 12.75], [22.25, 39.75]]


def test_the_weaker_of_two_near_peaks_and_peaks_below_the_threshold_are_none(model, start_table):
    picture = spots()
    picture[15, 58] = 240
    for radius_px, threshold, count in ((2, 0.5, 3), (4, 0.5, 2), (4, 0.9, 1)):
        parameters = {"model": model("heat"), "radius_px": radius_px, "threshold": threshold}
        answer = start_table("onnx-heatmap", **parameters).ask(picture)
        assert len(answer["points"]) == count


def test_a_model_of_one_size_is_given_that_size_and_says_what_is_too_large(model, start_table):
    detector = start_table("onnx-heatmap", model=model("heat", size=(48, 80)))
    assert detector.ask(spots())["points"] == [[61.0, 13.0], [22.0, 40.0]]
    assert "images of 48 x 80 px" in detector.ask(spots((49, 70)))["error"]
    assert len(detector.ask(spots())["points"]) == 2


@pytest.mark.parametrize(
    ("name", "outputs", "said"),
    [
        ("onnx-heatmap", [], "parameter model is empty: copy this table"),
        ("onnx-heatmap", ["descriptors"], r"no output is a heat map.*found \(1, 64, 1, 1\)"),
        ("onnx-offset", ["heat"], r"no output is of offsets, \(1, 2, 8, 8\)"),
    ],
)
def test_a_model_that_does_not_fit_is_refused_in_the_last_line(
    name: str, outputs: list[str], said: str, model, start_table
):
    with pytest.raises(AssertionError, match=said):
        start_table(name, model=model(*outputs) if outputs else "")


def test_a_file_that_is_no_model_is_refused(tmp_path: Path, start_table):
    with pytest.raises(AssertionError, match=r"nowhere\.onnx is not there"):
        start_table("onnx-heatmap", model="nowhere.onnx")
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(AssertionError, match=r"text\.onnx: .*[Pp]rotobuf"):
        start_table("onnx-heatmap", model="text.onnx")


SEEDS = [[1.0, 2.0], [3.5, 4.5]]
SMALL = np.zeros((8, 10), np.uint8)


def test_seeds_come_as_they_are_and_answers_go_as_they_are(start_text):
    program = start_text("serve(refine=lambda exposure, seeds: seeds + 0.1, version=7)")
    assert program.ready["version"] == "7"
    assert program.ready["does"] == ["refine"]
    assert set(program.ready["libraries"]) == {"numpy", "python"}
    answer = program.ask(SMALL, seeds=[[0.1, 1e-17], [1e9, -3.0]])
    assert answer["points"] == [[0.1 + 0.1, 1e-17 + 0.1], [1e9 + 0.1, -3.0 + 0.1]]


def test_samples_are_those_of_the_file_also_when_it_was_written_again(start_text):
    program = start_text(
        "def detect(exposure):\n    return [[int(exposure.image.sum()), exposure.image.shape[1]]]\n"
        'serve(detect=detect, version="1")'
    )
    for size in ((8, 10), (3, 4), (50, 60)):
        picture = np.random.default_rng(3).integers(0, 256, size, np.uint8)
        assert program.ask(picture)["points"] == [[int(picture.sum()), size[1]]]


def test_none_declines_a_corner(start_text):
    program = start_text('serve(refine=lambda exposure, seeds: [None, seeds[1]], version="1")')
    assert program.ask(SMALL, seeds=SEEDS)["points"] == [None, SEEDS[1]]


@pytest.mark.parametrize("points", ["seeds * float('nan')", "[seeds[0], (float('inf'), 1.0)]"])
def test_what_is_not_finite_is_refused_in_a_sentence(points: str, start_text):
    program = start_text(f'serve(refine=lambda exposure, seeds: {points}, version="1")')
    assert "say None to decline a corner" in program.ask(SMALL, seeds=SEEDS)["error"]


def test_an_exception_is_an_error_with_file_and_line_and_not_the_end(start_text):
    program = start_text(
        "def refine(exposure, seeds):\n"
        "    if len(seeds) > 1:\n"
        "        raise KeyError('too many')\n"
        "    return seeds\n"
        'serve(refine=refine, version="1")'
    )
    assert program.ask(SMALL, seeds=SEEDS)["error"] == "KeyError: 'too many' (own.py:4)"
    assert program.ask(SMALL, seeds=SEEDS[:1])["points"] == SEEDS[:1]
    assert "Traceback" in program.end()


def test_what_is_printed_goes_to_standard_error(start_text):
    program = start_text(
        "import os\n"
        "def refine(exposure, seeds):\n"
        "    print('printed', flush=True)\n"
        "    os.system('echo by a child')\n"
        "    return seeds\n"
        'serve(refine=refine, version="1")'
    )
    assert program.ask(SMALL, seeds=SEEDS)["points"] == SEEDS
    said = program.end()
    assert "printed" in said and "by a child" in said


def test_parameters_are_keyword_arguments(start_text):
    program = start_text(
        "def refine(exposure, seeds, *, by_px, name='none'):\n"
        "    return seeds + by_px if name == 'right' else seeds\n"
        'serve(refine=refine, version="1")',
        by_px=0.5,
        name="right",
    )
    assert program.ask(SMALL, seeds=SEEDS)["points"] == [[1.5, 2.5], [4.0, 5.0]]


def test_an_unknown_parameter_is_refused_when_greeted(start_text):
    for answer in ("detect=lambda exposure: []", "refine=lambda exposure, seeds: seeds"):
        with pytest.raises(AssertionError, match=r"windw=3\): .* unexpected .* 'windw'"):
            start_text(f'serve({answer}, version="1")', windw=3)


def test_a_version_may_depend_on_parameters(start_text):
    program = start_text(
        'serve(detect=lambda exposure, model: [], version=lambda model: f"of {model}")', model="a"
    )
    assert program.ready["version"] == "of a"
    assert program.ask(SMALL)["points"] == []


def test_more_than_points_is_said_of_each_corner(start_text):
    program = start_text(
        "serve(refine=lambda exposure, seeds: Corners(seeds, ['ok', 'max_iterations'],\n"
        "    [[[4.0, 1.0], [1.0, 2.0]], None], [3, 40]), version='1')"
    )
    answer = program.ask(SMALL, seeds=SEEDS)
    assert answer["statuses"] == ["ok", "max_iterations"]
    assert answer["covariances_px2"] == [[4.0, 1.0, 2.0], None]
    assert answer["iterations"] == [3, 40]


def test_a_task_that_it_does_not_do_is_an_error(start_text):
    program = start_text('serve(detect=lambda exposure: [], version="1")')
    assert "does not refine" in program.ask(SMALL, seeds=SEEDS)["error"]
