"""Objects are whole meshes of the wanted height, and red ones are red."""

import numpy as np
import pytest

from cornerscenes import cuboid
from cornerscenes.objects import BUILDERS
from cornerscenes.shape import vertex_normals


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_an_object_is_finite_stands_on_the_floor_and_repeats(name: str):
    parts = BUILDERS[name](np.random.default_rng(3), 0.3)
    vertices = np.concatenate([part.vertices for part in parts])
    assert np.isfinite(vertices).all()
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert vertices[:, 2].max() == pytest.approx(0.3, abs=1e-9)
    assert len({part.name for part in parts}) == len(parts)
    for part in parts:
        corners = part.vertices[part.triangles]
        edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (0.5 * np.linalg.norm(edges, axis=1) > 1e-12).all()
    again = BUILDERS[name](np.random.default_rng(3), 0.3)
    assert all((a.vertices == b.vertices).all() for a, b in zip(parts, again, strict=True))


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_an_object_is_red_at_some_exposure_if_its_name_says_so(name: str):
    reddest = -np.inf
    for seed in range(4):
        for part in BUILDERS[name](np.random.default_rng(seed), 0.3):
            for exposure in np.geomspace(0.05, 1.0 / max(part.material.colour), 40):
                linear = np.clip(np.array(part.material.colour) * exposure, 1e-9, 1.0)
                encoded = np.where(
                    linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
                )
                red, green, blue = 255.0 * encoded
                reddest = max(reddest, min(red - green, red - blue))
    assert (reddest >= 60.0) == name.startswith("red_")


def test_normals_at_the_corners_of_a_cuboid_point_along_its_diagonals():
    vertices = cuboid.vertices((0.1, 0.2, 0.3))
    triangles = np.array([[f[0], f[k], f[k + 1]] for f in cuboid.FACES for k in (1, 2)])
    normals = vertex_normals(vertices, triangles)
    outwards = np.sign(vertices - [0.0, 0.0, 0.15])
    assert np.abs(normals - outwards / np.sqrt(3.0)).max() < 1e-12
