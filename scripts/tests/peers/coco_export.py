"""A COCO export, opened by pycocotools, beside the dataset it was made from.

Run by `tests/it/export.rs`, with the folders in CORNERBENCH_EXPORT and CORNERBENCH_DATASET.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from pycocotools import mask as run_lengths
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

EXPORT = Path(os.environ["CORNERBENCH_EXPORT"])
DATASET = Path(os.environ["CORNERBENCH_DATASET"])
PEER: Any = COCO(str(EXPORT / "annotations.json"))
IMAGES = list(PEER.imgs.values())
every_image = pytest.mark.parametrize("image", IMAGES, ids=lambda image: image["file_name"])


def truth(image: dict[str, Any]) -> dict[str, Any]:
    return json.loads((scene(image) / "truth.json").read_text())


def scene(image: dict[str, Any]) -> Path:
    return DATASET / Path(image["file_name"]).stem


def annotation(image: dict[str, Any]) -> dict[str, Any]:
    (only,) = PEER.imgToAnns[image["id"]]
    return only


def keypoints(image: dict[str, Any]) -> np.ndarray:
    return np.reshape(annotation(image)["keypoints"], (-1, 3))


def test_every_scene_of_the_dataset_is_an_image():
    scenes = json.loads((DATASET / "dataset.json").read_text())["scenes"]
    assert [f"{name}.png" for name in scenes] == [image["file_name"] for image in IMAGES]


@every_image
def test_the_picture_is_the_camera_s(image: dict[str, Any]):
    picture = np.asarray(Image.open(EXPORT / "images" / image["file_name"])).astype(int)
    assert picture.shape == (image["height"], image["width"], 3)
    preview = np.asarray(Image.open(scene(image) / "preview.png"))
    assert np.abs(picture - preview).max() <= 1


@every_image
def test_the_mask_is_what_the_central_rays_meet(image: dict[str, Any]):
    target = json.loads((scene(image) / "scene.json").read_text())["target"]["object_id"]
    path = str(scene(image) / "geometry.exr")
    ids = OpenEXR.File(path, separate_channels=True).channels()["object.id"].pixels
    assert (PEER.annToMask(annotation(image)) == (ids == target)).all()


@every_image
def test_box_and_area_are_those_of_the_mask(image: dict[str, Any]):
    # pycocotools measures a mask's box from the image's corner: column 0 alone is from 0 to 1.
    mask = PEER.annToRLE(annotation(image))
    assert annotation(image)["bbox"] == run_lengths.toBbox(mask).tolist()
    assert annotation(image)["area"] == run_lengths.area(mask)
    assert annotation(image)["iscrowd"] == 0


@every_image
def test_keypoints_are_the_true_corners_with_their_visibility(image: dict[str, Any]):
    flags = {"visible": 2, "occluded": 1, "self-occluded": 1, "outside": 0}
    expected = []
    for corner in truth(image)["corners"]:
        x, y = corner["image_point_px"]
        inside = -0.5 <= x < image["width"] - 0.5 and -0.5 <= y < image["height"] - 0.5
        flag = flags[corner["visibility"]] if inside else 0
        # COCO keypoints count pixels from 0, as ours do: no shift.
        expected.append([x, y, flag] if flag else [0, 0, 0])
    assert np.abs(keypoints(image) - expected).max() < 1e-6
    labelled = sum(flag > 0 for _, _, flag in expected)
    assert annotation(image)["num_keypoints"] == labelled


def test_every_flag_occurs():
    flags = {flag for image in IMAGES for flag in keypoints(image)[:, 2]}
    assert flags == {0, 1, 2}


def test_boxes_are_measured_from_the_corner_of_the_image_and_keypoints_from_a_pixel_s_centre():
    (image,) = (image for image in IMAGES if image["file_name"] == "above.png")
    # All corners of this target are in the image and nothing hides a part of its outline.
    assert (keypoints(image)[:, 2] > 0).all()
    x, y, width, height = annotation(image)["bbox"]
    edges = np.array([[x, y], [x + width, y + height]])
    points = keypoints(image)[:, :2] + 0.5
    # A pixel belongs to the mask when its centre does: edges of the box round the corners.
    assert np.abs(edges - [points.min(axis=0), points.max(axis=0)]).max() <= 0.5


@every_image
def test_the_category_names_every_corner_and_edge(image: dict[str, Any]):
    (category,) = PEER.loadCats(annotation(image)["category_id"])
    corners = truth(image)["corners"]
    assert category["keypoints"] == [f"vertex{corner['index']}" for corner in corners]
    edges = [edge["corners"] for edge in truth(image)["edges"]]
    assert category["skeleton"] == [[a + 1, b + 1] for a, b in edges]
    assert category["supercategory"] == "cuboid"


def average_precision(shift_px: float) -> float:
    """Return the keypoint AP of the truth, every corner moved to the right, as detections."""
    detections = []
    for known in PEER.anns.values():
        moved = np.reshape(known["keypoints"], (-1, 3)) + np.array([shift_px, 0, 0])
        shared = {name: known[name] for name in ("image_id", "category_id")}
        detections.append({**shared, "keypoints": moved.ravel().tolist(), "score": 1.0})
    evaluation = COCOeval(PEER, PEER.loadRes(detections), "keypoints")
    (category,) = PEER.loadCats(PEER.getCatIds())
    evaluation.params.kpt_oks_sigmas = np.full(len(category["keypoints"]), 0.05)
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    return evaluation.stats[0]


def test_the_truth_as_detection_has_average_precision_one():
    assert average_precision(0.0) == 1.0
    assert average_precision(4.0) < 0.9
