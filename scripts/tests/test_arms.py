"""The arm gets where it says, and stands where nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from cornergrasps import arm as arms
from cornergrasps.engine import mj
from cornergrasps.model import build, reach_m
from cornergrasps.plan import Plan, place, plan, stances
from tests.grasping import UP, arm_of, board, from_above, gripper, outcome, robot, scenery


@pytest.mark.parametrize("name", ["youbot", "long-arm"])
def test_the_arm_is_where_its_inverse_kinematics_say(name: str):
    used = robot(name)
    model = build(scenery(), used, gripper())
    data = mj.MjData(model.model)
    hand = model.model.body("hand").id
    generator = np.random.default_rng(1)
    low, high = np.radians(np.array(arm_of(used).limits_deg)).T
    found = 0
    for _ in range(200):
        joints = generator.uniform(low, high)
        still = Plan(np.zeros(3), np.array([1.0, 0, 0, 0]), joints[None], joints[None], 0.1)
        place(model, data, still, joints)
        mj.mj_kinematics(model.model, data)
        position, turn = data.xpos[hand].copy(), data.xmat[hand].reshape(3, 3).copy()
        approach = turn[:, 2]
        flange = position - reach_m(gripper()) * approach
        bearing = joints[0]
        forwards = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        tilt = float(np.arctan2(approach @ forwards, approach[2]))
        solved = [
            pitches
            for elbow in (1, -1)
            for pitches, within in [
                arms.solutions(arm_of(used), np.array([flange @ forwards, flange[2]]), tilt, elbow)
            ]
            if within
        ]
        assert min(np.abs(pitches - joints[1:4]).max() for pitches in solved) < 1e-6
        roll = arms.roll(arm_of(used), bearing, tilt, turn[:, 0])
        assert roll is not None
        assert abs((roll - joints[4] + 0.5 * np.pi) % np.pi - 0.5 * np.pi) < 1e-6
        found += 1
    assert found == 200


def test_an_arm_stands_where_nothing_is_and_lifts_what_the_gripper_lifts():
    made, used = scenery(), robot("long-arm")
    model = build(made, used, gripper())
    data = mj.MjData(model.model)
    planned = plan(made, used, gripper(), model, data, from_above())
    assert isinstance(planned, Plan)
    hand = model.model.body("hand").id
    for joints, wanted in zip(planned.there, from_above().way_there_m(gripper()), strict=True):
        place(model, data, planned, joints)
        mj.mj_kinematics(model.model, data)
        assert np.linalg.norm(data.xpos[hand] - wanted) < 1e-9
    assert np.allclose(data.xmat[hand].reshape(3, 3)[:, 2], -UP)
    assert abs(data.xmat[hand].reshape(3, 3)[:, 0] @ from_above().jaw) == pytest.approx(1.0)
    assert outcome(from_above(), by=robot("long-arm")) == "success"
    high = replace(from_above(), point_m=np.array([0.0, 0.0, 2.0]))
    assert outcome(high, by=robot("youbot")) == "unreachable"


def test_an_arm_does_not_reach_through_its_own_platform():
    made, used = scenery(), robot("long-arm")
    model = build(made, used, gripper())
    data = mj.MjData(model.model)
    planned = plan(made, used, gripper(), model, data, from_above())
    assert isinstance(planned, Plan)
    for geometry in ("platform", "column"):
        assert model.room[model.model.geom(geometry).id] == "unreachable"
    low = np.array([0.0, np.radians(120.0), 0.0, np.radians(50.0), 0.0])  # down onto it
    behind = planned.there[0] * 0.0 + low
    behind[0] = np.pi
    place(model, data, planned, behind)
    mj.mj_kinematics(model.model, data)
    mj.mj_collision(model.model, data)
    assert "unreachable" in {model.touched(pair) for pair in data.contact.geom}
    place(model, data, planned, planned.there[0])
    mj.mj_kinematics(model.model, data)
    mj.mj_collision(model.model, data)
    assert {model.touched(pair) for pair in data.contact.geom} == {None}


def test_the_planes_of_an_arm_hold_the_approach():
    generator = np.random.default_rng(2)
    for _ in range(100):
        approach = generator.normal(size=3)
        approach /= np.linalg.norm(approach)
        planes = arms.planes(approach, 12)
        assert len(planes) >= 2
        for bearing, tilt in planes:
            forwards = np.array([np.cos(bearing), np.sin(bearing), 0.0])
            told = np.sin(tilt) * forwards + np.cos(tilt) * UP
            assert approach @ told > np.cos(np.radians(arms.SIDEWAYS_DEG)) - 1e-12
    assert len(arms.planes(-UP, 12)) == 12


def test_what_is_out_of_reach_has_no_joints():
    arm = arm_of(robot("long-arm"))
    far = np.array([arm.upper_arm_m + arm.forearm_m + 0.1, arm.base_m[1]])
    for elbow in (1, -1):
        _, reached = arms.solutions(arm, np.stack([far, 3.0 * far]), 0.0, elbow)
        assert not reached.any()


def test_every_stance_reaches_the_grasp_within_the_limits_and_stands_on_nothing():
    boards = [board(0.35, 0.0), board(-0.4, -0.1, 0.3), board(0.1, -0.5, 1.2)]
    made, used, grasp = scenery(*boards), robot("long-arm"), from_above()
    limits_deg = ((-70.0, 70.0), *arm_of(used).limits_deg[1:])
    arm = arm_of(used).model_copy(update={"limits_deg": limits_deg})
    assert used.platform_m is not None
    model = build(made, used, gripper())
    data = mj.MjData(model.model)
    hand, platform = model.model.body("hand").id, model.model.geom("platform").id
    low, high = np.radians(np.array(arm.limits_deg)).T
    headings = set()
    for count, stance in enumerate(stances(made, arm, used.platform_m, gripper(), grasp)):
        way = np.concatenate([stance.there, stance.up])
        assert (way >= low).all() and (way <= high).all()
        wanted = np.concatenate([grasp.way_there_m(gripper()), grasp.way_up_m()])
        for index in (0, len(stance.there) - 1, len(way) - 1):
            place(model, data, stance, way[index])
            mj.mj_kinematics(model.model, data)
            assert np.linalg.norm(data.xpos[hand] - wanted[index]) < 1e-9
            turn = data.xmat[hand].reshape(3, 3)
            assert np.allclose(turn[:, 2], -UP) and abs(turn[:, 0] @ grasp.jaw) > 1.0 - 1e-12
        turn = data.geom_xmat[platform].reshape(3, 3)
        headings.add(round(float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])) - way[0, 0]), 1))
        inside = np.abs((made.obstacle_points_m - data.geom_xpos[platform]) @ turn)
        assert not (inside < 0.5 * np.array(used.platform_m)).all(axis=1).any()
        corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
        corners = data.geom_xpos[platform] + corners * used.platform_m @ turn.T
        assert corners[:, :2].max() < 0.5  # where the walls are
        if count == 200:
            break
    assert len(headings) > 3


def test_an_arm_that_touches_the_target_has_bumped_into_it():
    model = build(scenery(), robot("long-arm"), gripper())
    link, palm = (model.model.geom(name).id for name in ("link 3", "palm"))
    assert model.touched((link, model.target)) == "target"
    assert model.touched((model.target, palm)) is None
