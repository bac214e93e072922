"""The conventions of image, camera and world, against hand numbers."""

import numpy as np
import pytest

from cornerscenes.camera import (
    Camera,
    image_points_from_film,
    inverse,
    looking_at,
    looking_down,
    standing,
    transformed,
)


def test_the_optical_axis_meets_the_middle_between_the_central_pixels():
    camera = Camera.with_field_of_view(512, 512, 90.0)
    assert camera.fx_px == pytest.approx(256.0)
    assert camera.project(np.array([[0.0, 0.0, 3.0]])).tolist() == [[255.5, 255.5]]


def test_right_and_down_in_the_camera_are_right_and_down_in_the_image():
    camera = Camera(100, 80, 50.0, 60.0, 49.5, 39.5)
    (point,) = camera.project(np.array([[0.2, 0.1, 2.0]]))
    assert point.tolist() == pytest.approx([54.5, 42.5])


def test_the_camera_that_looks_down_has_world_x_right_and_world_y_up():
    camera = Camera(100, 100, 100.0, 100.0, 49.5, 49.5)
    camera_from_world = inverse(looking_down((0.0, 0.0, 1.0)))
    points = transformed(camera_from_world, np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]))
    image = camera.project(points)
    assert image[0].tolist() == pytest.approx([59.5, 49.5])
    assert image[1].tolist() == pytest.approx([49.5, 39.5])


def test_the_target_of_a_camera_is_on_its_axis_and_up_is_up():
    pose = looking_at(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 0.5]))
    camera_from_world = inverse(pose)
    centre, above = transformed(camera_from_world, np.array([[0, 0, 0.5], [0, 0, 0.6]]))
    assert centre[:2].tolist() == pytest.approx([0.0, 0.0], abs=1e-12)
    assert centre[2] == pytest.approx(np.sqrt(1 + 4 + 6.25))
    assert above[0] == pytest.approx(0.0, abs=1e-12)
    assert above[1] < 0.0
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_standing_turns_counter_clockwise_seen_from_above():
    (point,) = transformed(standing(1.0, 2.0, np.pi / 2), np.array([[1.0, 0.0, 0.5]]))
    assert point.tolist() == pytest.approx([1.0, 3.0, 0.5])


def test_rays_undo_projection():
    camera = Camera.with_field_of_view(64, 48, 50.0)
    pixels = camera.pixel_centres()
    assert pixels[0].tolist() == [0.0, 0.0]
    assert pixels[65].tolist() == [1.0, 1.0]
    assert np.abs(camera.project(3.0 * camera.rays(pixels)) - pixels).max() < 1e-12


def test_the_corner_of_the_film_is_half_a_pixel_outside_the_first_centre():
    film = np.array([[0.0, 0.0], [2.0, 6.0]])
    assert image_points_from_film(film, 4).tolist() == [[-0.5, -0.5], [0.0, 1.0]]
