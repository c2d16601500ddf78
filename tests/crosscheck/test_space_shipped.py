"""What users run in space: MuJoCo stepped to rest, and the closed-chain example of Pinocchio; refusals by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from crosscheck.engines import EngineRefusal
from crosscheck.engines.loading import load
from crosscheck.judge.comparison import compare, reference
from crosscheck.scenes.hard import hard_cases
from refkin.joints import DisplacementDriver
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import Stewart

from . import space_scenes


def hooke() -> Scene:
    return next(case.scene for case in hard_cases() if case.key == "gimbal pose of a Hooke joint, 1e-02")


def lifted() -> Scene:
    """The screw jack, driven along its screw, of long lead: with a short one it swings for more than 20 s."""
    jack = space_scenes.screw_jack()
    screw, *others = jack.mechanism.joints
    lift = DisplacementDriver(name="lift", joint="H", law=Polynomial(coefficients=(0.3, 0.05)))
    joints = (replace(screw, pitch=1.0), *others)  # type: ignore[call-arg]
    return replace(jack, mechanism=replace(jack.mechanism, joints=joints, drivers=(lift,)))


def stewart() -> Scene:
    return Stewart.three_three().scene(speed=1.0, samples=13)


def few(make: Callable[[], Scene]) -> Scene:
    scene = make()
    return replace(scene, times=scene.times[:2])


def shipped(engine: str, scene: Scene) -> tuple[Motion, float]:
    """Return an answer by the method of its users, and its largest error / allowed."""
    peer = load(engine)
    (route,) = peer.discovery()  # type: ignore[attr-defined]
    motion = peer.solve(scene, route)
    compared = compare(reference(scene), motion, peer.terms(scene, route))
    assert not compared.other_assembly
    return motion, max(q.ratio[k] for q in compared.quantities.values() for k in range(2))


SPACE = (space_scenes.rssr, space_scenes.rssr_by_distance, space_scenes.rssp, space_scenes.bennett, hooke)
MUJOCO = (*SPACE, space_scenes.screw_jack, space_scenes.two_slides, lifted, stewart, *space_scenes.GEARED)


@pytest.mark.parametrize("make", MUJOCO, ids=lambda make: make.__name__)
def test_mujoco_comes_to_rest_in_space_well_within_what_soft_constraints_leave(make: Callable[[], Scene]) -> None:
    motion, ratio = shipped("mujoco", few(make))
    assert set(motion.status) == {Status.OK}
    assert ratio < 0.01  # 3e-4 at most


@pytest.mark.parametrize("make", [space_scenes.rssr, space_scenes.rssp, hooke], ids=lambda make: make.__name__)
def test_the_example_of_pinocchio_closes_loops_of_space_to_its_tolerance(make: Callable[[], Scene]) -> None:
    motion, ratio = shipped("pinocchio", few(make))
    assert set(motion.status) == {Status.OK}
    assert ratio < 1.0


def test_the_example_of_pinocchio_says_that_it_does_not_end_on_redundant_rows() -> None:
    scene = few(space_scenes.bennett)
    peer = load("pinocchio")
    assert set(peer.solve(scene, peer.discovery()[0]).status) == {Status.NOT_CONVERGED}  # type: ignore[attr-defined]


REFUSED = [
    ("mujoco", space_scenes.double_hooke, "universal 'U2', which closes a loop"),
    ("pinocchio", space_scenes.double_hooke, "universal 'U2'"),
    ("pinocchio", space_scenes.rssr_by_distance, "distance 'L'"),
    ("pinocchio", space_scenes.screw_jack, "angle 'motor'"),
    ("pinocchio", space_scenes.bevel_wheels, "gear 'one two'"),
]


@pytest.mark.parametrize(("engine", "make", "named"), REFUSED)
def test_what_has_no_constraint_is_refused_by_name(engine: str, make: Callable[[], Scene], named: str) -> None:
    peer = load(engine)
    (route,) = peer.discovery()  # type: ignore[attr-defined]
    with pytest.raises(EngineRefusal, match=f"refuses {named}.* by the method '{route.name}'"):
        peer.solve(few(make), route)
