"""A prismatic joint that closes a loop behind a guide turned by a constant angle: the angle it holds counts that."""

from __future__ import annotations

import pytest

from crosscheck.engines.mujoco import model as mujoco_model
from crosscheck.measure.check import check
from refkin import AngleDriver, Body, Mechanism, Polynomial, Prismatic, Revolute, Scene

TURN, HELD = 0.4, -0.3


def drawn_telescope() -> Scene:
    """A block slides along x, turned by 0.4 against its guide; a rod pinned to it slides in a turning sleeve."""
    bodies = (
        Body(name="block", estimate=(2.0, 0.0, TURN)),
        Body(name="rod", estimate=(2.0, 0.0, 0.5 + HELD)),
        Body(name="sleeve", estimate=(0.0, -1.0, 0.5)),
    )
    origin = (0.0, 0.0)
    joints = (
        Prismatic(
            name="guide", body_i="ground", point_i=origin, axis_i=(1.0, 0.0), body_j="block", point_j=origin, angle=TURN
        ),
        Revolute(name="pin", body_i="block", point_i=origin, body_j="rod", point_j=origin),
        Revolute(name="pivot", body_i="ground", point_i=(0.0, -1.0), body_j="sleeve", point_j=origin),
        Prismatic(
            name="bore", body_i="sleeve", point_i=origin, axis_i=(1.0, 0.0), body_j="rod", point_j=origin, angle=HELD
        ),
    )
    motor = AngleDriver(name="motor", body="sleeve", law=Polynomial(coefficients=(0.5, 0.2)))
    return Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 0.5, 1.0, 1.5), name="telescope")


@pytest.mark.parametrize("engine", ["mujoco", "pinocchio", "exudyn"])
def test_engines_agree_on_it(engine):
    record = check(drawn_telescope(), [engine])

    assert record.reference.verdict == "ok"
    assert [item for item in record.disagreements if item.method != "shipped"] == []


def test_a_turn_counted_with_the_wrong_sign_is_found(monkeypatch):
    angle = mujoco_model.Plan._angle

    def other_way(self, name, c):
        self.tree.angle_offsets.update({body: -turn for body, turn in self.tree.angle_offsets.items()})
        angle(self, name, c)

    monkeypatch.setattr(mujoco_model.Plan, "_angle", other_way)

    assert check(drawn_telescope(), ["mujoco"]).disagreements
