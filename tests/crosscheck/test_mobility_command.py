"""`crosscheck mobility`: what it prints of a scene, and its exit codes."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import refkin
from crosscheck.commands.solve import mobility
from refkin.joints import GROUND, Revolute
from refkin.motion_laws import Polynomial
from refkin.scenes.files import to_toml
from refkin.scenes.linkages import RSSP, RSSR, Bennett, Hooke, RSSRChain
from tests.passive import loop, rod_of_two


def told(tmp_path, capsys, scene, **options):
    """The exit code and the lines printed."""
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene), encoding="utf-8")
    code = mobility(path, **options)
    return code, capsys.readouterr().out.splitlines()


def slider_crank(**more):
    return refkin.SliderCrank(0.2, 0.35).scene(samples=2, **more)


def with_pin(scene, **ends):
    again = Revolute(name="again", **ends)
    return replace(scene, mechanism=replace(scene.mechanism, joints=(*scene.mechanism.joints, again)))


def test_a_slider_crank_is_a_mechanism_with_one_freedom(tmp_path, capsys):
    code, lines = told(tmp_path, capsys, slider_crank())

    assert code == 0
    assert lines[0] == "by count: 3 x 4 bodies - 11 equations, 3 of them the ground's, = 1, mechanism with one freedom"
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


def too_far():
    scene = refkin.SliderCrank(0.2, 0.35).scene(driven="slider", law=Polynomial(coefficients=(0.5,)), times=[0.0])
    driver = replace(scene.mechanism.drivers[0], law=Polynomial(coefficients=(0.6,)))
    return replace(scene, mechanism=replace(scene.mechanism, drivers=(driver,)))


def test_without_a_pose_there_is_a_count_and_no_rank(tmp_path, capsys):
    code, lines = told(tmp_path, capsys, too_far())

    assert code == 1
    assert lines[0].startswith("by count")
    assert lines[1].startswith("by rank: no pose at t = 0")


LINKAGE = RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125))
OF_SPACE = {
    "RSSR": (LINKAGE.scene(start=0.4, samples=2), 2, 2, ["coupler"]),
    "RSSP": (RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25)).scene(samples=2), 2, 2, ["rod"]),
    "chain": (RSSRChain(LINKAGE, 2).scene(start=0.4, samples=2), 3, 3, ["coupler1", "coupler2"]),
    "rod of two bodies": (loop(rod_of_two, 7)[0], 2, 2, ["b and b2"]),
    "Bennett": (Bennett(1.0, 0.7, 1.2).scene(start=0.4, samples=2), -2, 1, []),
    "Hooke": (Hooke(0.5).scene(start=0.4, samples=2), -2, 1, []),
}


@pytest.mark.parametrize("name", OF_SPACE)
def test_what_spins_passively_is_named_by_count_and_by_rank_in_text_and_in_json(name, tmp_path, capsys):
    scene, by_count, by_rank, passive = OF_SPACE[name]
    code, lines = told(tmp_path, capsys, scene)
    _, (text,) = told(tmp_path, capsys, scene, as_json=True)
    answer = json.loads(text)

    assert code == 0
    assert f" = {by_count}, " in lines[0]
    assert lines[0].endswith(f"{len(passive)} of them passive: {', '.join(passive)}") == bool(passive)
    assert f" = {by_rank}, " in lines[1]
    named = [
        line.removeprefix("passive degree of freedom: ")
        for line in lines
        if line.startswith("passive degree of freedom: ")
    ]
    assert [words.partition(" spin")[0] for words in named] == passive
    assert (f"drivers leave {len(passive)} of these free" in "\n".join(lines), "all passive" in lines[-1]) == (
        True,
        bool(passive),
    )
    assert (answer["by_count"]["mobility"], answer["by_rank"]["mobility"]) == (by_count, by_rank)
    assert (answer["by_count"]["passive"], answer["by_rank"]["passive"]) == (passive, named)
    assert len(answer["by_rank"]["joints"]["redundant"]) == by_rank - by_count
    assert sum(line.startswith("redundant: ") for line in lines) == by_rank - by_count


def test_without_a_pose_json_says_why_and_gives_no_rank(tmp_path, capsys):
    code, (text,) = told(tmp_path, capsys, too_far(), as_json=True)

    assert code == 1
    assert json.loads(text)["by_rank"] is None
    assert "gap" in json.loads(text)["message"]
