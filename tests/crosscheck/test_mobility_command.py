"""`crosscheck mobility`: what it prints of a scene, and its exit codes."""

from __future__ import annotations

from dataclasses import replace

import refkin
from crosscheck.commands.mobility import mobility
from refkin.joints import GROUND, Revolute
from refkin.motion_laws import Polynomial
from refkin.scenes.files import to_toml


def told(tmp_path, capsys, scene):
    """The exit code and the lines printed."""
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene), encoding="utf-8")
    code = mobility(path)
    return code, capsys.readouterr().out.splitlines()


def slider_crank(**more):
    return refkin.SliderCrank(0.2, 0.35).scene(samples=2, **more)


def with_pin(scene, **ends):
    again = Revolute(name="again", **ends)
    return replace(scene, mechanism=replace(scene.mechanism, joints=(*scene.mechanism.joints, again)))


def test_a_slider_crank_is_a_mechanism_with_one_freedom(tmp_path, capsys):
    code, lines = told(tmp_path, capsys, slider_crank())

    assert code == 0
    assert lines[0] == "by count: 3 x 4 bodies - 11 equations = 1, mechanism with one freedom"
    assert lines[1].startswith("by rank at t = 0: 9 coordinates - rank 8 = 1, mechanism with one freedom")
    assert lines[2].startswith("drivers leave 0 of these free")


def test_redundant_rows_are_named_with_those_they_depend_on(tmp_path, capsys):
    ends = {"body_i": GROUND, "point_i": (0.0, 0.0), "body_j": "crank", "point_j": (-0.1, 0.0)}
    code, lines = told(tmp_path, capsys, with_pin(slider_crank(), **ends))

    assert code == 0
    assert lines[0].endswith("= -1, overconstrained: 1 equation more than coordinates")
    assert [line for line in lines if line.startswith("redundant")] == [
        "redundant: again[0] depends on A0[0]",
        "redundant: again[1] depends on A0[1]",
    ]


def test_a_driver_that_holds_nothing_at_a_dead_centre_is_named(tmp_path, capsys):
    """Crank 1/4 and rod 1/2, stretched at 3/4: numbers without rounding."""
    law = Polynomial(coefficients=(0.75, -0.1))
    pull = refkin.SliderCrank(0.25, 0.5).scene(driven="slider", law=law, times=[0.0])
    code, lines = told(tmp_path, capsys, pull)

    assert code == 0
    assert "a driver that holds nothing here: driver depends on A0[0], A[0], B[0]" in lines
    assert any(line.startswith("drivers leave 1 of these free") for line in lines)


def test_a_structure_is_called_by_that_name(tmp_path, capsys):
    """The slider pinned where it stands: then its driver says nothing new, and nothing can move."""
    scene = slider_crank(start=1.0)
    x, y, _ = refkin.solve(scene)["slider"].q[:, 0]
    ends = {"body_i": GROUND, "point_i": (float(x), float(y)), "body_j": "slider", "point_j": (0.0, 0.0)}
    code, lines = told(tmp_path, capsys, with_pin(scene, **ends))

    assert code == 0
    assert lines[1].startswith("by rank at t = 0: 9 coordinates - rank 9 = 0, structure")


def test_without_a_pose_there_is_a_count_and_no_rank(tmp_path, capsys):
    far = slider_crank(driven="slider", law=Polynomial(coefficients=(0.5,)), times=[0.0])
    driver = replace(far.mechanism.drivers[0], law=Polynomial(coefficients=(0.6,)))
    code, lines = told(tmp_path, capsys, replace(far, mechanism=replace(far.mechanism, drivers=(driver,))))

    assert code == 1
    assert lines[0].startswith("by count")
    assert lines[1].startswith("by rank: no pose at t = 0")
