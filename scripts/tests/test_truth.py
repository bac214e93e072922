"""Truth against brute-force ray casts in float64, written without the renderer."""

import numpy as np
import pytest

from cornerscenes import buffers, cuboid, mitsuba_backend
from cornerscenes.camera import Camera, looking_at, standing, transformed
from cornerscenes.layout import (
    FIRST_OBJECT_ID,
    TARGET_ID,
    PlacedObject,
    Scene,
    Shape,
    Target,
)
from cornerscenes.room import room
from cornerscenes.shape import Material, Part
from cornerscenes.truth import truth

RED = Material((0.6, 0.02, 0.02))
SIZE = (0.16, 0.12, 0.18)


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mitsuba_backend.choose_variant()


def slab() -> PlacedObject:
    """Return a thin upright board that stands before a part of the target."""
    size = (0.02, 0.10, 0.16)
    part = Part("board", cuboid.vertices(size), cuboid.part(size, RED).triangles, RED, smooth=False)
    shape = Shape.of((part,))
    return PlacedObject(FIRST_OBJECT_ID, "board", 0.16, shape, standing(0.08, 0.09, 0.9))


def scene(with_board: bool = True) -> Scene:
    target = Target(SIZE, standing(0.2, 0.22, 0.35), RED)
    centre = target.vertices_m().mean(axis=0)
    light = mitsuba_backend.Light((1, 1, 1), (1, 1, 1), 5.0, (-1, -1, 2), 0.5, (0, 0, 0))
    return Scene(
        camera=Camera.with_field_of_view(96, 80, 40.0),
        range_camera=Camera.with_field_of_view(12, 10, 40.0),
        world_from_camera=looking_at(np.array([-0.35, -0.3, 0.6]), centre),
        target=target,
        objects=(slab(),) if with_board else (),
        surfaces=room(0.45, 0.45, 3.0, 1.4, "test"),
        light=light,
    )


def triangles_of(drawn: Scene) -> np.ndarray:
    """Every triangle of target and objects in the world [m], shape (n, 3, 3)."""
    part = cuboid.part(SIZE, RED)
    found = [transformed(drawn.target.world_from_cuboid, part.vertices)[part.triangles]]
    for item in drawn.objects:
        for mesh in item.shape.parts:
            found.append(transformed(item.world_from_object, mesh.vertices)[mesh.triangles])
    return np.concatenate(found)


def is_hidden(eye: np.ndarray, point: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a segment from eye to point meets a triangle before its end (Moeller-Trumbore)."""
    direction = point - eye
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(direction, edge2)
    determinant = np.einsum("ij,ij->i", edge1, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        from_corner = eye - triangles[:, 0]
        u = np.einsum("ij,ij->i", from_corner, across) / determinant
        perpendicular = np.cross(from_corner, edge1)
        v = perpendicular @ direction / determinant
        t = np.einsum("ij,ij->i", edge2, perpendicular) / determinant
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1 - 1e-6)
    return bool(inside.any())


@pytest.mark.parametrize("with_board", [False, True])
def test_corner_visibility_equals_brute_force(with_board: bool):
    drawn = scene(with_board)
    found = truth(drawn, drawn.world(2))
    triangles = triangles_of(drawn)
    eye = drawn.world_from_camera[:3, 3]
    seen = [corner["visibility"] == "visible" for corner in found["corners"]]
    expected = [
        not is_hidden(eye, np.array(corner["position_m"]), triangles) for corner in found["corners"]
    ]
    assert seen == expected
    kinds = [corner["visibility"] for corner in found["corners"]]
    assert kinds.count("self-occluded") == 1
    assert ("occluded" in kinds) == with_board
    assert sum(seen) == 7 - kinds.count("occluded")


def test_fractions_of_faces_and_edges_equal_brute_force():
    drawn = scene()
    found = truth(drawn, drawn.world(2))
    triangles = triangles_of(drawn)
    eye = drawn.world_from_camera[:3, 3]
    facing = drawn.target.facing(eye)
    assert len(facing) == 3
    partly = 0
    for face in found["faces"]:
        points = drawn.target.face_points_m(face["index"], 24)
        shown = np.mean([not is_hidden(eye, point, triangles) for point in points])
        assert face["facing"] == (face["index"] in facing)
        expected = shown if face["facing"] else 0.0
        assert face["visible_fraction"] == pytest.approx(expected, abs=0.02)
        partly += 0.05 < face["visible_fraction"] < 0.95
    assert partly >= 1
    assert 0.3 < found["target_visible_fraction"] < 0.95
    for edge in found["edges"]:
        start, end = drawn.target.vertices_m()[edge["corners"]]
        steps = (np.arange(200) + 0.5)[:, None] / 200
        shown = [not is_hidden(eye, point, triangles) for point in start + steps * (end - start)]
        assert edge["visible_fraction"] == pytest.approx(np.mean(shown), abs=0.01)


def test_a_corner_outside_the_frame_is_outside():
    drawn = scene(with_board=False)
    narrow = Camera.with_field_of_view(96, 80, 8.0)
    drawn = Scene(**{**vars(drawn), "camera": narrow})
    kinds = {corner["visibility"] for corner in truth(drawn, drawn.world(2))["corners"]}
    assert "outside" in kinds
    assert "visible" in kinds or "self-occluded" in kinds


def test_geometry_is_the_brute_force_hit_through_each_pixel_s_centre():
    drawn = scene()
    geometry = buffers.cast_geometry(drawn, drawn.world(2))
    eye = drawn.world_from_camera[:3, 3]
    pixels = drawn.camera.pixel_centres()
    directions = drawn.camera.rays(pixels) @ drawn.world_from_camera[:3, :3].T
    target = np.flatnonzero(geometry.object_id.ravel() == TARGET_ID)
    assert len(target) > 200
    normal_from_world = np.linalg.inv(drawn.target.world_from_cuboid[:3, :3])
    for index in target[:: len(target) // 40]:
        face = int(geometry.face_id.ravel()[index])
        normal = drawn.target.normal(face)
        corner = drawn.target.vertices_m()[cuboid.FACES[face][0]]
        depth = normal @ (corner - eye) / (normal @ directions[index])  # rays have z = 1
        assert geometry.depth_m.ravel()[index] == pytest.approx(depth, abs=2e-6)
        rendered = geometry.normal.reshape(-1, 3)[index]
        assert np.abs(normal_from_world @ rendered - cuboid.NORMALS[face]).max() < 1e-5
    off_target = geometry.face_id[geometry.object_id != TARGET_ID]
    assert (off_target == buffers.NO_FACE).all()


def test_range_points_lie_on_their_rays_at_the_depth_seen_there():
    drawn = scene()
    points = buffers.cast_range(drawn, drawn.world(2)).reshape(-1, 3)
    rays = drawn.range_camera.rays(drawn.range_camera.pixel_centres())
    assert (points[:, 2] > 0).all()
    assert np.abs(points - rays * points[:, 2:]).max() < 1e-6


def test_faces_are_wound_counter_clockwise_seen_from_outside():
    vertices = cuboid.vertices(SIZE)
    for face, corners in enumerate(cuboid.FACES):
        a, b, c, _ = vertices[list(corners)]
        normal = np.cross(b - a, c - b)
        assert np.allclose(normal / np.linalg.norm(normal), cuboid.NORMALS[face])
    assert len(cuboid.EDGES) == 12
    assert sorted(cuboid.faces_of_vertex(0)) == [0, 2, 4]


def test_the_film_holds_the_projected_silhouette_and_not_its_mirror_image():
    drawn = scene(with_board=False)
    world = drawn.world(2)
    image = world.radiance(drawn.camera, drawn.world_from_camera, 2, (0, 0, 96, 80), 16, 1)
    red = image[..., 0] > 3.0 * image[..., 1]
    ids = buffers.cast_geometry(drawn, world).object_id == TARGET_ID
    binned = red.reshape(80, 2, 96, 2).mean(axis=(1, 3)) > 0.5
    agree = (binned == ids).mean()
    assert agree > 0.97
    assert (binned == ids[:, ::-1]).mean() < agree - 0.01
    assert (binned == ids[::-1]).mean() < agree - 0.01


def test_a_window_of_the_film_is_the_same_place_as_in_the_whole_film():
    drawn = scene(with_board=False)
    world = drawn.world(2)
    whole = world.radiance(drawn.camera, drawn.world_from_camera, 2, (0, 0, 96, 80), 64, 1)
    part = world.radiance(drawn.camera, drawn.world_from_camera, 2, (30, 20, 70, 60), 64, 2)
    inside = whole[40:120, 60:140]
    assert part.shape == inside.shape
    assert np.abs(part - inside).mean() < 0.1 * inside.mean()
    moved = whole[41:121, 60:140]
    assert np.abs(part - inside).mean() < np.abs(part - moved).mean()
