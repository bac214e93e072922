"""The study of visibility, small: it agrees with truth.json, and finds what is wrong in one."""

from dataclasses import replace

import pytest
from scenes import checkerboard, scene, slab

from cornerscenes import mitsuba_backend
from cornerscenes.camera import Camera, standing
from cornerscenes.mitsuba_backend import World
from cornerscenes.scene import FIRST_OBJECT_ID, Scene
from cornerscenes.truth import truth
from studies.visibility import disagreements

LEANING = slab(standing(0.05, 0.15, 0.2), (0.01, 0.02, 0.3), FIRST_OBJECT_ID + 1)
SCENES = {
    "two before a cuboid": scene(slab(), LEANING),
    "one before a board": scene(slab(), target=checkerboard()),
    "cut by the frame": scene(slab(), camera=Camera.with_field_of_view(96, 80, 8.0)),
}


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mitsuba_backend.choose_variant()


@pytest.mark.parametrize("drawn", SCENES.values(), ids=SCENES.keys())
def test_truth_and_brute_force_disagree_nowhere_but_at_boundaries(drawn: Scene):
    world = World.of(drawn, 2)
    found = disagreements(drawn, world, truth(drawn, world), 6000)
    assert found["points"] > 5000
    assert 0.02 < found["hidden"] / found["points"] < 0.98
    assert found["far"] == 0, found


def test_what_is_wrong_by_a_fifth_of_a_millimetre_is_found():
    drawn = SCENES["two before a cuboid"]
    world = World.of(drawn, 2)
    content = truth(drawn, world)
    moved = 0
    for edge in content["edges"]:
        for part in edge["visible"]:
            if part["ended_by"] != "vertex":
                part["end"] += 0.0015
                moved += 1
    assert moved
    found = disagreements(drawn, world, content, 20_000)
    assert found["far"] >= 1
    assert 1e-5 < found["worst_m"] < 3e-4


def test_a_corner_that_is_called_visible_and_is_not_is_found():
    drawn = SCENES["two before a cuboid"]
    world = World.of(drawn, 2)
    content = truth(drawn, world)
    hidden = next(c for c in content["corners"] if c["visibility"] == "occluded")
    hidden["visibility"] = "visible"
    assert disagreements(drawn, world, content, 100)["far"] == 1


def test_a_face_whose_occluder_the_renderer_lacks_is_found():
    drawn = SCENES["one before a board"]
    without = World.of(replace(drawn, objects=()), 2)
    found = disagreements(drawn, without, truth(drawn, World.of(drawn, 2)), 2000)
    assert found["far"] > 20
