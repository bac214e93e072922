"""Film, coverage, geometry and range against what follows from the poses alone."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERA, checkerboard, scene, slab, target

from cornerscenes import buffers, cuboid, mitsuba_backend
from cornerscenes.camera import looking_at, transformed
from cornerscenes.coverage import coverage
from cornerscenes.film import Window
from cornerscenes.mitsuba_backend import World
from cornerscenes.scene import NO_FACE, TARGET_ID, Lens, Scene

WHOLE = Window(0, 0, CAMERA.width, CAMERA.height)


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mitsuba_backend.choose_variant()


def covered(drawn: Scene, window: Window = WHOLE) -> np.ndarray:
    return coverage(drawn, World.of(drawn, 2), 4, window, "test")


def area_px2(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_geometry_is_the_brute_force_hit_through_each_pixel_s_centre():
    drawn = scene(slab())
    geometry = buffers.cast_geometry(drawn, World.of(drawn, 2))
    pixels = drawn.camera.pixel_centres()
    directions = drawn.camera.rays(pixels) @ drawn.world_from_camera[:3, :3].T
    hits = np.flatnonzero(geometry.object_id.ravel() == TARGET_ID)
    assert len(hits) > 200
    target_from_world = np.linalg.inv(drawn.target.world_from_target[:3, :3])
    for index in hits[:: len(hits) // 40]:
        face = int(geometry.face_id.ravel()[index])
        normal = drawn.target.normal(face)
        corner = drawn.target.vertices_m()[cuboid.FACES[face][0]]
        depth = normal @ (corner - drawn.eye_m) / (normal @ directions[index])  # rays have z = 1
        assert geometry.depth_m.ravel()[index] == pytest.approx(depth, abs=2e-6)
        rendered = geometry.normal.reshape(-1, 3)[index]
        assert np.abs(target_from_world @ rendered - cuboid.NORMALS[face]).max() < 1e-5
    assert (geometry.face_id[geometry.object_id != TARGET_ID] == NO_FACE).all()


def test_range_points_in_the_sensor_s_own_frame_are_the_surfaces_it_looks_at():
    elsewhere = looking_at(np.array([-0.1, -0.4, 0.5]), np.array([0.25, 0.2, 0.05]))
    drawn = scene(world_from_range=elsewhere)
    points = buffers.cast_range(drawn, World.of(drawn, 2)).reshape(-1, 3)
    rays = drawn.range_camera.rays(drawn.range_camera.pixel_centres())
    assert (points[:, 2] > 0).all()
    assert np.abs(points - rays * points[:, 2:]).max() < 1e-6
    in_world = transformed(elsewhere, points)
    in_target = transformed(np.linalg.inv(drawn.target.world_from_target), in_world)
    size = np.array(drawn.target.size_m)
    beyond = np.abs(in_target - [0, 0, 0.5 * size[2]]) - 0.5 * size
    on_target = np.abs(beyond.max(axis=1)) < 2e-6
    on_floor = np.abs(in_world[:, 2]) < 2e-6
    on_wall = (np.abs(in_world[:, :2] - 0.45) < 2e-6).any(axis=1)
    assert (on_target | on_floor | on_wall).all()
    assert on_target.sum() >= 5
    assert on_floor.sum() >= 5


def test_footprints_are_the_same_surfaces_all_over_each_cell():
    drawn = scene()
    world = World.of(drawn, 2)
    points = buffers.cast_range(drawn, world)
    fine = buffers.cast_footprints(drawn, world)
    height, width = points.shape[:2]
    times = buffers.RANGE_OVERSAMPLING
    assert fine.shape == (times * height, times * width)
    # On one plane the inverse of depth is linear in the image: its mean is that of the middle.
    inverse = 1.0 / fine.reshape(height, times, width, times).astype(np.float64)
    bends = [np.abs(np.diff(inverse, 2, axis=axis)).max(axis=(1, 3)) for axis in (1, 3)]
    flat = np.maximum(*bends) < 1e-4
    assert 40 < flat.sum() < 110, "most cells see one plane, some mix near and far"
    middle = inverse.mean(axis=(1, 3))
    assert np.abs(middle * points[..., 2] - 1.0)[flat].max() < 1e-5
    # One row off is a thousand times that.
    assert np.abs(middle[:-1] * points[1:, :, 2] - 1.0)[flat[:-1]].max() > 0.01


@pytest.mark.parametrize("bevel_m", [0.0, 0.02])
def test_coverage_is_the_area_of_the_projected_faces(bevel_m: float):
    drawn = scene(target=target(bevel_m))
    image = covered(drawn)
    points = drawn.image_of(drawn.target.vertices_m())
    facing = drawn.target.facing(drawn.eye_m)
    assert len(facing) == 3
    for channel, face in enumerate(facing):
        found = float(image[..., channel].sum()) / 16.0
        expected = area_px2(points[list(cuboid.FACES[face])])
        if bevel_m:
            width, height = drawn.target.face_extent_m(face)
            expected *= (1 - 2 * bevel_m / width) * (1 - 2 * bevel_m / height)
        # Perspective makes the flat part of a rounded body's face another share than in space.
        assert found == pytest.approx(expected, rel=0.03 if bevel_m else 2e-3)
    assert float(image.sum(axis=2).max()) <= 1.0


def test_coverage_of_a_window_is_the_same_place_as_in_the_whole():
    drawn = scene()
    whole = covered(drawn)
    part = covered(drawn, Window(30, 20, 70, 60))
    inside = whole[80:240, 120:280]
    assert part.shape == inside.shape
    # Samples differ; a window that is off by one film cell differs by whole edges.
    assert np.abs(part - inside).sum() < 0.2 * np.abs(part - whole[81:241, 120:280]).sum()


def test_what_stands_before_the_target_takes_its_coverage():
    free, hidden = covered(scene()), covered(scene(slab()))
    assert hidden.sum() < 0.95 * free.sum()
    assert (hidden <= free + 0.2).all()


def test_coverage_of_a_board_is_its_black_squares_and_the_rest():
    drawn = scene(target=checkerboard())
    image = covered(drawn)
    black, rest = (float(image[..., channel].sum()) for channel in (0, 1))
    # 8 of the 15 squares are black; the margin makes 35.
    assert black / (black + rest) == pytest.approx(8 / 35, rel=0.05)
    assert image[..., 2].max() == 0.0


def test_the_film_holds_the_projected_silhouette_and_not_its_mirror_image():
    drawn = scene()
    world = World.of(drawn, 2)
    view = world.seen_by(drawn.camera, drawn.world_from_camera)
    (cells,) = view.passes(WHOLE.pixels(), 1, 2, 16, 1, "test")
    image = WHOLE.image_of(cells)
    red = image[..., 0] > 3.0 * image[..., 1]
    ids = buffers.cast_geometry(drawn, world).object_id == TARGET_ID
    binned = red.reshape(80, 2, 96, 2).mean(axis=(1, 3)) > 0.5
    agree = (binned == ids).mean()
    assert agree > 0.97
    assert (binned == ids[:, ::-1]).mean() < agree - 0.01
    assert (binned == ids[::-1]).mean() < agree - 0.01


def test_a_lens_in_focus_covers_as_the_pinhole_does_and_out_of_focus_blurs():
    drawn = scene()
    sharp = covered(drawn)
    blurred = covered(replace(drawn, lens=Lens(0.01, 0.4)))
    assert float(blurred.sum()) == pytest.approx(float(sharp.sum()), rel=0.02)
    partial = [((image > 0.02) & (image < 0.98)).mean() for image in (sharp, blurred)]
    assert partial[1] > 2.0 * partial[0]
