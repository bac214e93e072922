"""The scene as a model of MuJoCo: room, clutter, target, robot and gripper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from cornergrasps.clutter import pieces
from cornergrasps.engine import Body, CompiledModel, Spec, mj
from cornergrasps.recipes import Arm, Gripper, Robot
from cornergrasps.scenery import Scenery
from cornerscenes.camera import transformed

# Of what the targets are: a rigid foam, so that an arm for half a kilogram lifts the largest.
DENSITY_KG_M3 = 60.0

# Coulomb's coefficient of all but the pads.
FRICTION = 0.5

# How long a step of the simulation is [s].
STEP_S = 0.002

# What is behind the surfaces of the room [m].
_WALL_M = 0.05

# Who touches whom, as bits of MuJoCo's contype and conaffinity: the robot does not touch itself.
_ROOM, _TARGET, _ROBOT = 1, 2, 4

# What a robot can bump into.
Obstacle = Literal["unreachable", "ground", "wall", "clutter", "target"]

# For the contacts of a robot that stands in a bush.
_MEMORY_BYTES = 256 * 1024 * 1024

# How stiff joints are driven [1/s^2]: a place is held as by a critically damped spring.
_STIFFNESS = 20000.0

# What a motor is tuned to carry beside the gripper [kg]: no target is as heavy. An arm's is tuned
# to an ordinary one, at its end.
_MOST_TARGET_KG, _PAYLOAD_KG = 1.0, 0.3

# What the carriage of a flying gripper exerts along each axis [N]: enough for any of them.
_CARRIAGE_N = 400.0

# Inertia of an arm's motors, and of a hand about the flange's axis at least [kg m^2].
_ARMATURE_KG_M2, _HAND_KG_M2 = 0.01, 0.02

# The pad is this thick of the finger [m], and weighs next to nothing [kg].
_PAD_M, _PAD_KG = 0.002, 0.001

# How the mass of a gripper is shared out; each of two fingers has its share.
_PALM_SHARE, _FINGER_SHARE = 0.7, 0.15

# What the fingers' screw and motor weigh as the jaws feel it [kg], and how it brakes [N s/m].
_SCREW_KG, _SCREW_NS_M = 0.5, 20.0


@dataclass(frozen=True)
class Model:
    """A compiled model, and where in it things are.

    Attributes
    ----------
    model : CompiledModel
        The model.
    room : dict[int, str]
        Of each geometry that neither the target nor what moves of the robot has, what touching it
        is called: "ground", "wall", "clutter", and "unreachable" of the robot's own platform.
    robot : frozenset[int]
        The geometries of arm and gripper; the pads are among them.
    platform : frozenset[int]
        Those of what carries the arm.
    fingers : tuple[frozenset[int], frozenset[int]]
        Those of the two fingers.
    hand : frozenset[int]
        Those of fingers and palm.
    target : int
        The target's geometry.
    joints : int
        How many joints carry the gripper.
    """

    model: CompiledModel
    room: dict[int, Obstacle]
    robot: frozenset[int]
    platform: frozenset[int]
    fingers: tuple[frozenset[int], frozenset[int]]
    hand: frozenset[int]
    target: int
    joints: int

    def touched(self, geometries: tuple[int, int]) -> Obstacle | None:
        """Return what of the room a robot touches, or its arm the target; `None` of all else."""
        one, other = (int(geometry) for geometry in geometries)
        own, other = (one, other) if one in self.robot else (other, one)
        if own not in self.robot:
            return None
        if other == self.target:
            return None if own in self.hand else "target"
        return self.room.get(other)

    def target_touches(self, geometries: tuple[int, int]) -> Obstacle | None:
        """Return what of the room the target touches."""
        pair = {int(geometry) for geometry in geometries}
        return self.room.get((pair - {self.target}).pop()) if self.target in pair else None


def build(scenery: Scenery, robot: Robot, gripper: Gripper) -> Model:
    """Return the model of a scene with a robot whose place is still to be chosen."""
    spec = mj.MjSpec()
    spec.compiler.degree = False
    spec.memory = _MEMORY_BYTES
    spec.option.timestep = STEP_S
    spec.option.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0  # friction that does not creep
    spec.option.noslip_iterations = 3
    spec.default.geom.solref = [2.0 * STEP_S, 1.0]  # as hard as the steps allow
    names = _room(spec, scenery)
    _target(spec, scenery)
    joints, standing = _robot(spec, robot, gripper)
    names |= standing
    model = spec.compile()
    room: dict[int, Obstacle] = {model.geom(name).id: called for name, called in names.items()}
    left, right = (
        frozenset({model.geom(f"{side} pad").id, model.geom(f"{side} finger").id})
        for side in ("left", "right")
    )
    target = model.geom("target").id
    own = frozenset(range(model.ngeom)) - set(room) - {target}
    platform = frozenset(model.geom(name).id for name in standing)
    hand = left | right | {model.geom("palm").id}
    return Model(model, room, own, platform, (left, right), hand, target, joints)


def _room(spec: Spec, scenery: Scenery) -> dict[str, Obstacle]:
    """Add floor, walls and clutter; return what touching each of them is called."""
    world = spec.worldbody
    names: dict[str, Obstacle] = {}
    touched = {"contype": _ROOM, "conaffinity": 0, "friction": _ordinary(FRICTION)}
    surfaces = scenery.surfaces_m or {"floor": _floor_below(scenery)}
    for name, (first, second, third, fourth) in surfaces.items():
        normal = np.cross(second - first, fourth - first)
        normal /= np.linalg.norm(normal)
        axes = np.stack([(second - first), (fourth - first)])
        sides = np.linalg.norm(axes, axis=1)
        turn = np.column_stack([axes[0] / sides[0], axes[1] / sides[1], normal])
        world.add_geom(
            name=name,
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[*(0.5 * sides + _WALL_M), 0.5 * _WALL_M],
            pos=0.5 * (first + third) - 0.5 * _WALL_M * normal,
            quat=quaternion(turn),
            **touched,
        )
        names[name] = "ground" if name == "floor" else "wall"
    for thing in scenery.things:
        for index, points in enumerate(pieces(thing.parts)):
            name = f"{thing.name} {index}"
            mesh = spec.add_mesh(name=name, inertia=mj.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            mesh.uservert = transformed(thing.world_from_object, points).ravel()
            world.add_geom(name=name, type=mj.mjtGeom.mjGEOM_MESH, meshname=name, **touched)
            names[name] = "clutter"
    return names


def _floor_below(scenery: Scenery) -> Float[np.ndarray, "4 3"]:
    """Return a floor at z = 0 for a scene that has none: the robot must stand somewhere."""
    x, y, _ = scenery.centre_m
    return np.array([[x + a, y + b, 0.0] for a, b in ((-2, -2), (2, -2), (2, 2), (-2, 2))])


def _target(spec: Spec, scenery: Scenery) -> None:
    body = spec.worldbody.add_body(
        name="target",
        pos=scenery.centre_m,
        quat=quaternion(scenery.world_from_target[:3, :3]),
    )
    body.add_freejoint(name="target")
    body.add_geom(
        name="target",
        type=mj.mjtGeom.mjGEOM_BOX,
        size=0.5 * scenery.size_m,
        density=DENSITY_KG_M3,
        contype=_TARGET,
        conaffinity=_ROOM | _ROBOT,
        friction=_ordinary(FRICTION),
    )
    spec.add_equality(
        name="held",
        type=mj.mjtEq.mjEQ_WELD,
        objtype=mj.mjtObj.mjOBJ_BODY,
        name1="target",
        name2="world",
        data=[0.0] * 10 + [1.0, 0.0],  # as it is, turned as stiffly as moved
        solref=[2.0 * STEP_S, 1.0],
        active=scenery.is_held,
    )


def _robot(spec: Spec, robot: Robot, gripper: Gripper) -> tuple[int, dict[str, Obstacle]]:
    """Add the robot.

    Returns
    -------
    int
        How many joints carry the gripper.
    dict[str, Obstacle]
        What of it stands still, and what touching that is called: a stance from which the robot
        touches its own platform is none.
    """
    root = spec.worldbody.add_body(name="root", mocap=True)
    if robot.arm is None or robot.platform_m is None:
        _hand(spec, _carriage(spec, root, gripper), gripper)
        return 3, {}
    names = _platform(root, robot.arm, robot.platform_m)
    _hand(spec, _arm(spec, root, robot.arm, gripper), gripper)
    return 5, dict.fromkeys(names, "unreachable")


def _carriage(spec: Spec, root: Body, gripper: Gripper) -> Body:
    """Add three straight joints, along the axes of the gripper's frame."""
    hand = root.add_body(name="hand", gravcomp=1.0)
    for axis in range(3):
        name = "xyz"[axis]
        hand.add_joint(
            name=name,
            type=mj.mjtJoint.mjJNT_SLIDE,
            axis=np.eye(3)[axis],
        )
        _drive(spec, name, gripper.mass_kg + _MOST_TARGET_KG, _CARRIAGE_N)
    return hand


def _platform(root: Body, arm: Arm, size_m: tuple[float, float, float]) -> list[str]:
    """Add the platform and the column on it that carries the arm; return their names.

    The root's frame is the first axis, on the floor, forwards along x.
    """
    touched = {"contype": _ROOM, "conaffinity": 0, "friction": _ordinary(FRICTION)}
    root.add_geom(
        name="platform",
        type=mj.mjtGeom.mjGEOM_BOX,
        size=[0.5 * side for side in size_m],
        pos=[-arm.base_m[0], 0.0, 0.5 * size_m[2]],
        **touched,
    )
    if arm.base_m[1] <= size_m[2]:
        return ["platform"]
    root.add_geom(
        name="column",
        type=mj.mjtGeom.mjGEOM_CYLINDER,
        size=[arm.radius_m, 0.5 * (arm.base_m[1] - size_m[2]), 0.0],
        pos=[0.0, 0.0, 0.5 * (arm.base_m[1] + size_m[2])],
        **touched,
    )
    return ["platform", "column"]


def _arm(spec: Spec, root: Body, arm: Arm, gripper: Gripper) -> Body:
    """Add the five links, each a capsule as long as it is to the next pitch, or a ball."""
    up, forwards, level = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]
    # Where each joint is on the link before it, about what it turns, and how long its link is.
    chain = [
        (arm.base_m[1] * up, up, 0.0),
        (arm.shoulder_m[0] * forwards + arm.shoulder_m[1] * up, level, arm.upper_arm_m),
        (arm.upper_arm_m * up, level, arm.forearm_m),
        (arm.forearm_m * up, level, arm.wrist_m),
        (arm.wrist_m * up, up, 0.0),
    ]
    body = root
    for index, (place, axis, length_m) in enumerate(chain):
        name = f"joint {index + 1}"
        body = body.add_body(name=f"link {index + 1}", pos=place, gravcomp=1.0)
        low, high = np.radians(arm.limits_deg[index])
        body.add_joint(
            name=name,
            type=mj.mjtJoint.mjJNT_HINGE,
            axis=axis,
            limited=mj.mjtLimited.mjLIMITED_TRUE,
            range=[low, high],
            armature=_ARMATURE_KG_M2,
        )
        form = (
            {"type": mj.mjtGeom.mjGEOM_CAPSULE, "fromto": [0.0] * 5 + [length_m]}
            if length_m > 0.0
            else {"type": mj.mjtGeom.mjGEOM_SPHERE}
        )
        body.add_geom(
            name=f"link {index + 1}",
            size=[arm.radius_m, 0.0, 0.0],
            mass=arm.mass_kg[index],
            contype=_ROBOT,
            conaffinity=_ROOM,
            **form,
        )
        # What a joint has to turn is at most all beyond it at the end of the arm stretched out.
        beyond_kg = sum(arm.mass_kg[index:]) + gripper.mass_kg + _PAYLOAD_KG
        stretched_m = sum(length for _, _, length in chain[max(index, 1) :])
        inertia = beyond_kg * max(stretched_m, arm.radius_m) ** 2
        _drive(spec, name, inertia + _HAND_KG_M2, arm.torque_nm[index])
    # The shoulder is in the column, whose end its first two links go round.
    for link in ("link 1", "link 2"):
        spec.add_exclude(bodyname1="root", bodyname2=link)
    # At 0 the jaws move sideways; the hand's origin is the face, so far beyond the flange.
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return body.add_body(
        name="hand", pos=[0.0, 0.0, reach_m(gripper)], quat=quaternion(turn), gravcomp=1.0
    )


def reach_m(gripper: Gripper) -> float:
    """Return how far the grasped face is from what the gripper is screwed to [m]."""
    return gripper.palm_m[2] + gripper.finger_m[2] - gripper.depth_m


def _drive(spec: Spec, joint: str, inertia: float, most: float) -> None:
    """Add a motor that holds a joint where it is told to be.

    Parameters
    ----------
    spec : Spec
        The model.
    joint : str
        Its name, the motor's too.
    inertia : float
        What it moves: [kg] of a straight joint, [kg m^2] of a turning one.
    most : float
        What it exerts at most: [N], or [N m].
    """
    spec.add_actuator(
        name=joint,
        trntype=mj.mjtTrn.mjTRN_JOINT,
        target=joint,
        gaintype=mj.mjtGain.mjGAIN_FIXED,
        gainprm=[_STIFFNESS * inertia] + [0.0] * 9,
        biastype=mj.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, -_STIFFNESS * inertia, -2.0 * np.sqrt(_STIFFNESS) * inertia] + [0.0] * 7,
        forcelimited=mj.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-most, most],
    )


def _hand(spec: Spec, hand: Body, gripper: Gripper) -> None:
    """Add palm and fingers: x along the jaws, z the way it comes, the origin on the face."""
    robot = {"contype": _ROBOT, "conaffinity": _ROOM, "friction": _ordinary(FRICTION)}
    thickness, width, length = gripper.finger_m
    pad_width, pad_length = gripper.pad_m
    back = gripper.depth_m - length
    hand.add_geom(
        name="palm",
        type=mj.mjtGeom.mjGEOM_BOX,
        size=[0.5 * side for side in gripper.palm_m],
        pos=[0.0, 0.0, back - 0.5 * gripper.palm_m[2]],
        mass=_PALM_SHARE * gripper.mass_kg,
        **robot,
    )
    half = 0.5 * gripper.most_opening_m
    for side, sign in (("left", -1.0), ("right", 1.0)):
        finger = hand.add_body(name=f"{side} finger", gravcomp=1.0)
        finger.add_joint(
            name=side,
            type=mj.mjtJoint.mjJNT_SLIDE,
            axis=[sign, 0.0, 0.0],
            limited=mj.mjtLimited.mjLIMITED_TRUE,
            range=[0.5 * gripper.least_opening_m, half + 1e-4],
            damping=_SCREW_NS_M,
            armature=_SCREW_KG,
        )
        finger.add_geom(
            name=f"{side} finger",
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[0.5 * (thickness - _PAD_M), 0.5 * width, 0.5 * length],
            pos=[
                sign * (_PAD_M + 0.5 * (thickness - _PAD_M)),
                0.0,
                back + 0.5 * length,
            ],
            mass=_FINGER_SHARE * gripper.mass_kg,
            **robot,
        )
        finger.add_geom(
            name=f"{side} pad",
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[0.5 * _PAD_M, 0.5 * pad_width, 0.5 * pad_length],
            pos=[sign * 0.5 * _PAD_M, 0.0, gripper.depth_m - 0.5 * pad_length],
            mass=_PAD_KG,
            contype=_ROBOT,
            conaffinity=_ROOM,
            friction=_ordinary(gripper.friction),
            condim=4,
            priority=1,
        )
    # One motor moves both alike.
    spec.add_equality(
        name="alike",
        type=mj.mjtEq.mjEQ_JOINT,
        objtype=mj.mjtObj.mjOBJ_JOINT,
        name1="left",
        name2="right",
        data=[0.0, 1.0] + [0.0] * 10,
        solref=[2.0 * STEP_S, 1.0],
    )
    moved_kg = 2.0 * (_SCREW_KG + _FINGER_SHARE * gripper.mass_kg)
    _drive(spec, "left", moved_kg, 2.0 * gripper.force_n)


def _ordinary(friction: float) -> list[float]:
    """Return Coulomb's coefficient [-] with those against turning and rolling [m]."""
    return [friction, 0.005, 0.0001]


def quaternion(turn: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix."""
    found = np.zeros(4)
    mj.mju_mat2Quat(found, np.ascontiguousarray(turn).ravel())
    return found
