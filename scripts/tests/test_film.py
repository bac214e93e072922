"""The film: finest where the corners are, with a noise that is what it says."""

from dataclasses import replace
from math import pi, sin, sqrt

import numpy as np
import pytest

from cornerscenes import cuboid, mitsuba_backend
from cornerscenes.camera import Camera, looking_at, standing
from cornerscenes.film import (
    CORNER_RADIUS_PX,
    FilmRenderer,
    SeenCorner,
    Window,
    binned,
    floor_px,
    passes_of,
    significant,
)
from cornerscenes.light import Lamp, Light
from cornerscenes.mitsuba_backend import World
from cornerscenes.noise_floor import SeenEdge, Sides, noise_floor_px, sides
from cornerscenes.recipes import FilmRecipe
from cornerscenes.scene import Scene
from cornerscenes.shape import Material
from cornerscenes.target import Target

SIZE = (0.16, 0.12, 0.18)
RECIPE = FilmRecipe(
    oversampling=2,
    periphery_samples=8,
    fovea_samples=8,
    corner_samples=128,
    noise_floor_px=0.02,
    margin_px=4,
    max_depth=3,
)


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mitsuba_backend.choose_variant()


def scene() -> Scene:
    """Return the cuboid alone, in the sky."""
    material = Material((0.6, 0.02, 0.02))
    target = Target(
        kind="cuboid",
        size_m=SIZE,
        wireframe=cuboid.wireframe(SIZE),
        parts=cuboid.sharp(SIZE, material),
        world_from_target=standing(0.2, 0.22, 0.35),
        bevel_radius_m=0.0,
        texture_corners_m=np.zeros((0, 3)),
    )
    pose = looking_at(np.array([-0.35, -0.3, 0.6]), target.vertices_m().mean(axis=0))
    camera = Camera.with_field_of_view(96, 80, 40.0)
    lamp = Lamp("square", (4.0, 4.0, 4.0), (-1.0, -0.6, 1.6), (0.2, 0.2, 0.1), 0.8)
    return Scene(
        camera=camera,
        range_camera=Camera.with_field_of_view(12, 10, 40.0),
        world_from_camera=pose,
        world_from_range=pose,
        lens=None,
        target=target,
        objects=(),
        surfaces=(),
        lines=(),
        light=Light((0.5, 0.5, 0.5), (0.3, 0.3, 0.3), (0.2, 0.2, 0.2), (lamp,)),
        names={},
        is_red=True,
    )


def seen(drawn: Scene, vertex: int) -> SeenCorner:
    """Return a vertex with its three edges, seen over ten pixels."""
    points = drawn.image_of(drawn.target.vertices_m())
    edges = []
    for index in drawn.target.wireframe.edges_at(vertex):
        a, b = drawn.target.wireframe.edges[index]
        along = points[b if a == vertex else a] - points[vertex]
        edges.append(SeenEdge(along / np.linalg.norm(along), 10.0))
    return SeenCorner(points[vertex], tuple(edges), 0.0)


def about(corner: SeenCorner) -> np.ndarray:
    """Return which pixels are about a corner."""
    x, y = np.meshgrid(np.arange(96), np.arange(80))
    to_x, to_y = corner.image_point_px
    return np.hypot(x - to_x, y - to_y) <= CORNER_RADIUS_PX


def test_the_cells_of_pixels_make_up_the_image():
    image = np.random.default_rng(1).random((40, 48, 3))
    window = Window(3, 2, 9, 10)
    pixels = window.pixels()
    cells = np.stack([image[4 * y : 4 * y + 4, 4 * x : 4 * x + 4] for x, y in pixels])
    assert np.array_equal(window.image_of(cells), window.of(image, 4))


@pytest.mark.parametrize("paths", [8, 12, 16, 24, 32, 128, 256, 512, 640, 2048])
def test_passes_make_up_the_number_of_paths(paths: int):
    each, passes = passes_of(paths)
    assert each * passes == paths
    assert passes >= 2
    assert each in (4, 16, 64, 256, 1024)


def test_significant_bits_bound_the_rounding():
    values = np.random.default_rng(2).lognormal(0.0, 3.0, 10_000).astype(np.float32)
    rounded = significant(values, 13)
    assert np.abs(rounded / values - 1.0).max() <= 2.0**-13
    assert len(np.unique(rounded.view(np.uint32) & np.uint32(2**11 - 1))) == 1
    assert significant(np.zeros(3, dtype=np.float32), 8).tolist() == [0.0, 0.0, 0.0]


def test_the_film_is_fine_in_the_box_finest_at_the_corner_and_coarse_elsewhere():
    drawn = scene()
    corner = seen(drawn, 4)
    film = FilmRenderer(drawn, World.of(drawn, 3), RECIPE, "test").film([corner])
    assert film.radiance.shape == (160, 192, 3)
    fovea = film.fovea_px
    outside = np.ones((80, 96), dtype=bool)
    fovea.of(outside)[:] = False
    cells = film.radiance.reshape(80, 2, 96, 2, 3)
    spread = np.ptp(cells, axis=(1, 3)).max(axis=2)
    assert (spread[outside] == 0.0).all()
    assert (spread[~outside] > 0.0).mean() > 0.5
    (samples,) = film.corner_samples
    assert RECIPE.fovea_samples < samples <= RECIPE.corner_samples
    box_alone = FilmRenderer(drawn, World.of(drawn, 3), RECIPE, "test").film([])
    near = about(corner)
    assert film.variance[near].mean() < 0.5 * box_alone.variance[near].mean()
    assert np.array_equal(film.variance[~near], box_alone.variance[~near])


def test_squares_of_pixels_show_what_single_pixels_show():
    drawn = scene()
    view = World.of(drawn, 3).seen_by(drawn.camera, drawn.world_from_camera)
    squares = 4 * Window(0, 0, 24, 20).pixels()
    coarse = np.array(list(view.passes(squares, 4, 4, 256, 8, "coarse")))
    tiles = coarse.reshape(8, 20, 24, 4, 4, 3).swapaxes(2, 3).reshape(8, 80, 96, 3)
    fine = np.array(list(view.passes(Window(0, 0, 96, 80).pixels(), 1, 1, 16, 8, "fine")))
    fine = fine.reshape(8, 80, 96, 3)
    difference = tiles.mean(axis=0) - fine.mean(axis=0)
    variance = (tiles.var(axis=0, ddof=1) + fine.var(axis=0, ddof=1)) / 8
    noisy = variance > 1e-8
    z = difference[noisy] / np.sqrt(variance[noisy])
    assert noisy.sum() > 2000
    # With 8 passes each z is of Student's kind; a shift by a pixel makes it many times that.
    assert np.median(np.abs(z)) == pytest.approx(0.69, abs=0.07)


def test_passes_are_made_until_the_noise_floor_is_met_and_no_further():
    drawn = scene()
    world, corner = World.of(drawn, 3), seen(drawn, 4)

    def rendered(noise_floor_px: float) -> tuple[int, float]:
        recipe = RECIPE.model_copy(update={"noise_floor_px": noise_floor_px})
        film = FilmRenderer(drawn, world, recipe, "test").film([corner])
        floor = floor_px(corner, binned(film.radiance, 2), film.variance)
        assert floor is not None
        return film.corner_samples[0], floor

    samples, first = rendered(1.0)
    assert samples == RECIPE.fovea_samples
    wanted = 0.5 * first
    samples, floor = rendered(wanted)
    assert 2 * RECIPE.fovea_samples <= samples < RECIPE.corner_samples
    assert wanted / 1.4 < floor < wanted * 1.1
    samples, _ = rendered(1e-4)
    assert samples == RECIPE.corner_samples


def test_the_variance_is_that_of_another_render():
    drawn = scene()
    world = World.of(drawn, 3)
    many = RECIPE.model_copy(update={"noise_floor_px": 1e-4})
    one, two = (FilmRenderer(drawn, world, many, key).film([seen(drawn, 4)]) for key in "ab")
    near = about(seen(drawn, 4))
    difference = (binned(one.radiance, 2) - binned(two.radiance, 2))[near]
    variance = (one.variance + two.variance)[near]
    noisy = variance > 1e-8  # the sky is not
    z = difference[noisy] / np.sqrt(variance[noisy])
    assert noisy.mean() > 0.2
    # With 16 passes each the variance is known to a quarter: z is nearly normal.
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.08)
    assert abs(z.mean()) < 0.1


def test_an_l_corner_s_floor_is_the_closed_form():
    beta, contrast, noise, length = np.deg2rad(70.0), 0.4, 0.003, 10.0
    side = Sides(np.array([contrast, 0.0, 0.0]), np.full(3, noise**2))
    directions = [np.array([1.0, 0.0]), np.array([np.cos(beta), np.sin(beta)])]
    found = noise_floor_px([(SeenEdge(d, length), side) for d in directions])
    sigma_e = sqrt(1.0 / 12.0)
    expected = 2.0 * sqrt(4.0 * sqrt(pi) * sigma_e * noise**2 / (contrast**2 * length)) / sin(beta)
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("beta_deg", [60.0, 90.0, 120.0])
def test_the_closed_form_is_near_the_exact_bound(beta_deg: float):
    """Against the Cramer-Rao bound of vertex and both directions, by finite differences."""
    noise, half = 0.01, 10
    first = np.deg2rad(17.0)
    truth = np.array([0.2, -0.3, first, first + np.deg2rad(beta_deg)])
    steps = (np.arange(16) + 0.5) / 16 - 0.5
    grid = np.arange(-half, half + 1)[:, None] + steps
    y, x = np.meshgrid(grid.ravel(), grid.ravel(), indexing="ij")

    def image(parameters: np.ndarray) -> np.ndarray:
        """Coverage of the wedge; a narrow ramp instead of a step keeps it differentiable."""
        dx, dy = x - parameters[0], y - parameters[1]
        a = -np.sin(parameters[2]) * dx + np.cos(parameters[2]) * dy
        b = np.sin(parameters[3]) * dx - np.cos(parameters[3]) * dy
        inside = np.clip(a / 0.1 + 0.5, 0.0, 1.0) * np.clip(b / 0.1 + 0.5, 0.0, 1.0)
        count = len(grid)
        return inside.reshape(count, 16, count, 16).mean(axis=(1, 3))

    step = 1e-3
    columns = [
        (image(truth + step * unit) - image(truth - step * unit)).ravel() / (2.0 * step)
        for unit in np.eye(4)
    ]
    jacobian = np.stack(columns, axis=1)
    covariance = np.linalg.inv(jacobian.T @ jacobian / noise**2)
    exact = sqrt(covariance[0, 0] + covariance[1, 1])
    directions = [np.array([np.cos(t), np.sin(t)]) for t in truth[2:]]
    side = Sides(np.array([1.0, 0.0, 0.0]), np.array([noise**2, 1.0, 1.0]))
    found = noise_floor_px([(SeenEdge(d, 10.0), side) for d in directions])
    assert found == pytest.approx(exact, rel=0.2)


def test_one_edge_or_none_with_contrast_has_no_floor():
    side = Sides(np.array([0.3, 0.0, 0.0]), np.full(3, 1e-4))
    flat = Sides(np.zeros(3), np.full(3, 1e-4))
    one, other = SeenEdge(np.array([1.0, 0.0]), 10.0), SeenEdge(np.array([0.0, 1.0]), 10.0)
    assert noise_floor_px([(one, side)]) is None
    assert noise_floor_px([(one, side), (other, flat)]) is None
    assert noise_floor_px([(one, side), (other, None)]) is None
    assert noise_floor_px([]) is None


def test_contrast_has_the_sign_of_right_minus_left():
    radiance = np.zeros((40, 40, 3))
    radiance[20:] = (0.5, 0.2, 0.1)  # below is to the right of what runs along x
    edge = SeenEdge(np.array([1.0, 0.0]), 10.0)
    found = sides(radiance, np.full((40, 40, 3), 1e-4), np.array([10.0, 19.5]), edge)
    assert found is not None
    assert found.contrast.tolist() == [0.5, 0.2, 0.1]
    back = replace(edge, direction=np.array([-1.0, 0.0]))
    found = sides(radiance, np.full((40, 40, 3), 1e-4), np.array([30.0, 19.5]), back)
    assert found is not None
    assert found.contrast.tolist() == [-0.5, -0.2, -0.1]
