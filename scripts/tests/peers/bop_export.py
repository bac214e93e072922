"""A BOP export, read by the format's published rules, beside the dataset it was made from.

Run by `tests/it/export.rs`, with the folders in CORNERBENCH_EXPORT and CORNERBENCH_DATASET. The
rules are those of bop_toolkit, `docs/bop_datasets_format.md`; nothing of the exporter is used.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

EXPORT = Path(os.environ["CORNERBENCH_EXPORT"])
DATASET = Path(os.environ["CORNERBENCH_DATASET"])


def load(path: Path) -> Any:
    return json.loads(path.read_text())


@dataclass(frozen=True)
class Model:
    """Points [mm] with their normals, and triangles of them."""

    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray


@dataclass(frozen=True)
class Shown:
    """A BOP scene of one image, and what the dataset holds of the scene that it shows."""

    name: str
    picture: np.ndarray
    intrinsics: np.ndarray
    camera: dict[str, Any]
    pose: dict[str, Any]
    rotation: np.ndarray
    info: dict[str, Any]
    depth_mm: np.ndarray
    whole: np.ndarray
    visible: np.ndarray
    model: Model
    truth: dict[str, Any]
    corners_px: np.ndarray
    target_id: int
    true_depth_mm: np.ndarray
    object_ids: np.ndarray


def picture(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def mask(path: Path) -> np.ndarray:
    values = picture(path)
    assert set(np.unique(values)) <= {0, 255}
    return values == 255


def model(path: Path) -> Model:
    header, body = path.read_text().split("end_header\n")
    assert "format ascii 1.0" in header
    counts = [int(line.split()[-1]) for line in header.splitlines() if "element" in line]
    properties = [line.split()[-1] for line in header.splitlines() if "property" in line]
    assert properties == ["x", "y", "z", "nx", "ny", "nz", "vertex_indices"]
    lines = [line.split() for line in body.splitlines()]
    assert len(lines) == sum(counts)
    vertices = np.array(lines[: counts[0]], dtype=float)
    faces = np.array(lines[counts[0] :], dtype=int)
    assert (faces[:, 0] == 3).all()
    return Model(vertices[:, :3], vertices[:, 3:], faces[:, 1:])


def shown(place: int, name: str) -> Shown:
    folder, scene = EXPORT / f"test/{place:06d}", DATASET / name
    camera = load(folder / "scene_camera.json")["0"]
    (pose,) = load(folder / "scene_gt.json")["0"]
    (info,) = load(folder / "scene_gt_info.json")["0"]
    steps = picture(folder / "depth/000000.png")
    assert steps.dtype in (np.uint16, np.int32)
    truth = load(scene / "truth.json")
    geometry = OpenEXR.File(str(scene / "geometry.exr"), separate_channels=True).channels()
    return Shown(
        name=name,
        picture=picture(folder / "rgb/000000.png"),
        intrinsics=np.reshape(camera["cam_K"], (3, 3)),
        camera=camera,
        pose=pose,
        rotation=np.reshape(pose["cam_R_m2c"], (3, 3)),
        info=info,
        depth_mm=steps * camera["depth_scale"],
        whole=mask(folder / "mask/000000_000000.png"),
        visible=mask(folder / "mask_visib/000000_000000.png"),
        model=model(EXPORT / f"models/obj_{pose['obj_id']:06d}.ply"),
        truth=truth,
        corners_px=np.array([corner["image_point_px"] for corner in truth["corners"]]),
        target_id=load(scene / "scene.json")["target"]["object_id"],
        true_depth_mm=1e3 * geometry["depth.Z"].pixels.astype(float),
        object_ids=geometry["object.id"].pixels,
    )


def projected(intrinsics: np.ndarray, points: np.ndarray) -> np.ndarray:
    homogeneous = points @ intrinsics.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


PLACES = {scene["place"]: scene["name"] for scene in load(EXPORT / "export.json")["scenes"]}
IMAGES = [shown(place, name) for place, name in PLACES.items()]
every_image = pytest.mark.parametrize("image", IMAGES, ids=list(PLACES.values()))


def test_every_scene_of_the_dataset_is_a_bop_scene():
    assert list(PLACES.values()) == list(load(DATASET / "dataset.json")["scenes"])
    assert sorted(path.name for path in (EXPORT / "test").iterdir()) == [f"{p:06d}" for p in PLACES]


@every_image
def test_model_vertices_project_onto_the_true_corners(image: Shown):
    in_camera_mm = image.model.points @ image.rotation.T + image.pose["cam_t_m2c"]
    points = projected(image.intrinsics, in_camera_mm)
    assert np.abs(points - image.corners_px).max() < 1e-6


@every_image
def test_world_points_project_onto_the_true_corners(image: Shown):
    in_world_mm = 1e3 * np.array([corner["position_m"] for corner in image.truth["corners"]])
    rotation = np.reshape(image.camera["cam_R_w2c"], (3, 3))
    points = projected(image.intrinsics, in_world_mm @ rotation.T + image.camera["cam_t_w2c"])
    assert np.abs(points - image.corners_px).max() < 1e-6


@every_image
def test_depth_is_the_geometry_s_to_half_a_step(image: Shown):
    step_mm = image.camera["depth_scale"]
    assert step_mm == 0.1
    assert np.abs(image.depth_mm - image.true_depth_mm).max() <= 0.5 * step_mm + 1e-9
    assert ((image.depth_mm == 0) == (image.true_depth_mm == 0)).all()


@every_image
def test_depth_at_the_centre_of_each_pixel_lies_on_the_model(image: Shown):
    # bop_toolkit: pixel (x, y), counted from 0, sees along the ray through image point (x, y).
    y, x = image.visible.nonzero()
    rays = np.stack([x, y, np.ones_like(x)], axis=1) @ np.linalg.inv(image.intrinsics).T
    points = rays * image.depth_mm[image.visible][:, None]
    in_model = (points - image.pose["cam_t_m2c"]) @ image.rotation
    # Distance to the box's surface: 0.06 mm is half a step of depth along the ray. Half a pixel
    # anywhere would be a millimetre.
    outside = np.abs(in_model) - image.model.points.max(axis=0)
    assert np.abs(outside.max(axis=1)).max() < 0.06


@every_image
def test_the_visible_mask_is_what_the_central_rays_meet(image: Shown):
    assert (image.visible == (image.object_ids == image.target_id)).all()


@every_image
def test_the_whole_mask_is_the_outline_of_the_projected_corners(image: Shown):
    hull = ConvexHull(image.corners_px)
    y, x = np.mgrid[: image.whole.shape[0], : image.whole.shape[1]]
    centres = np.stack([x.ravel(), y.ravel()], axis=1)
    beyond = (centres @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)
    beyond = beyond.reshape(image.whole.shape)
    assert image.whole[beyond < -1e-3].all()
    assert not image.whole[beyond > 1e-3].any()


@every_image
def test_counts_and_boxes_are_those_of_the_masks(image: Shown):
    def box(mask: np.ndarray) -> list[int]:
        y, x = mask.nonzero()
        return [x.min(), y.min(), x.max() - x.min(), y.max() - y.min()]

    # The targets of these scenes lie in the frame: nothing counts outside it.
    assert image.info == {
        "bbox_obj": box(image.whole),
        "bbox_visib": box(image.visible),
        "px_count_all": image.whole.sum(),
        "px_count_valid": (image.whole & (image.depth_mm > 0)).sum(),
        "px_count_visib": image.visible.sum(),
        "visib_fract": image.visible.sum() / image.whole.sum(),
    }


def test_a_part_of_some_target_is_hidden():
    assert min(image.info["visib_fract"] for image in IMAGES) < 0.99


@every_image
def test_the_picture_is_the_camera_s(image: Shown):
    preview = picture(DATASET / image.name / "preview.png").astype(int)
    assert np.abs(image.picture - preview).max() <= 1


@every_image
def test_the_model_s_info_is_that_of_its_points(image: Shown):
    info = load(EXPORT / "models/models_info.json")[str(image.pose["obj_id"])]
    points = image.model.points
    least = [info[f"min_{axis}"] for axis in "xyz"]
    size = [info[f"size_{axis}"] for axis in "xyz"]
    assert np.allclose(least, points.min(axis=0), rtol=0, atol=1e-9)
    assert np.allclose(size, np.ptp(points, axis=0), rtol=0, atol=1e-9)
    assert np.isclose(info["diameter"], pdist(points).max(), rtol=0, atol=1e-9)
    # The origin is the centre of the box.
    assert np.allclose(points.mean(axis=0), 0, atol=1e-9)
    # At least the half turns about the axes, and each takes the points onto themselves.
    turns = [np.reshape(turn, (4, 4)) for turn in info["symmetries_discrete"]]
    assert {tuple(np.diag(turn)[:3]) for turn in turns} >= {(1, -1, -1), (-1, 1, -1), (-1, -1, 1)}
    for turn in turns:
        assert np.isclose(np.linalg.det(turn), 1) and not np.allclose(turn, np.eye(4))
        turned = points @ turn[:3, :3].T + turn[:3, 3]
        assert all(np.abs(points - point).max(axis=1).min() < 1e-6 for point in turned)


@every_image
def test_the_model_s_faces_and_normals_look_outwards(image: Shown):
    model = image.model
    assert np.allclose(np.linalg.norm(model.normals, axis=1), 1)
    assert ((model.normals * model.points).sum(axis=1) > 0).all()
    a, b, c = (model.points[model.triangles[:, corner]] for corner in range(3))
    volumes = (np.cross(a, b) * c).sum(axis=1) / 6
    assert (volumes > 0).all()
    assert np.isclose(volumes.sum(), np.ptp(model.points, axis=0).prod())


def test_every_model_is_an_object_s_and_the_evaluation_s():
    models = load(EXPORT / "models/models_info.json")
    assert set(models) == {str(image.pose["obj_id"]) for image in IMAGES}
    # bop_toolkit's evaluation reads models in a folder of their own.
    for path in (EXPORT / "models").iterdir():
        assert path.read_bytes() == (EXPORT / "models_eval" / path.name).read_bytes()


def test_camera_and_targets_are_those_of_the_images():
    camera = load(EXPORT / "camera.json")
    k = IMAGES[0].intrinsics
    assert [camera[key] for key in ("fx", "fy", "cx", "cy")] == [k[0, 0], k[1, 1], *k[:2, 2]]
    assert (camera["height"], camera["width"]) == IMAGES[0].whole.shape
    assert camera["depth_scale"] == IMAGES[0].camera["depth_scale"]
    targets = load(EXPORT / "test_targets_bop19.json")
    assert targets == [
        {"im_id": 0, "inst_count": 1, "obj_id": image.pose["obj_id"], "scene_id": place}
        for place, image in zip(PLACES, IMAGES, strict=True)
        if image.info["visib_fract"] >= 0.1
    ]
