"""Grasps carried out in physics: a rendered scene, a robot, a gripper, gravity and friction."""
