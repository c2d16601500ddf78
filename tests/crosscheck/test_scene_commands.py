"""What commands tell of one scene, and their exit codes: `follow`, `diagnose`, `mobility` and `program`."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.commands.follow import lines
from refkin import Polynomial, SliderCrank
from refkin.fast import program_of
from refkin.joints import GROUND, Revolute, XDriver
from refkin.scenes.linkages import RSSP, RSSR, Bennett, Hooke, RSSRChain, ScrewJack
from refkin.solving.follow import TurningPoint
from tests.linkages import CHANGE_POINT, LIMITED, ROCKER, remade, with_law
from tests.passive import loop, rod_of_two
from tests.places import EXAMPLES

SCENE = EXAMPLES / "slider-crank.toml"


def limited():
    return LIMITED.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.0, 0.5))


def beyond():
    """A crank beyond its limit at the first time."""
    return replace(with_law(limited(), Polynomial(coefficients=(2.5, 1.0))), times=(0.0,))


def dead_centre():
    """Crank 1/4 and rod 1/2, stretched at 3/4: numbers without rounding."""
    law = Polynomial(coefficients=(0.75, -0.1))
    return SliderCrank(0.25, 0.5).scene(driven="slider", law=law, times=(0.0,))


def test_a_path_is_told_with_the_worst_radius_of_the_poses_that_are_proved():
    turns = [TurningPoint(t=1.5, q=np.zeros(3), index=1, is_maximum=most) for most in (True, False)]
    path = {"t": np.array([0.5, 1.5, 1.25]), "residual": np.array([1e-16, 2e-15, 3e-16]), "events": turns}
    path |= {"message": "it ends", "radius": np.array([1e-12, np.nan, 3e-11])}
    told = lines("turn", SimpleNamespace(**path))
    unproved = lines("turn", SimpleNamespace(**{**path, "radius": np.full(3, np.nan)}))

    assert told == [
        "3 poses, turn from 0.5",
        "2 of them proved to be alone, worst radius 3e-11; worst scaled residual 2e-15",
        "pose 1: turn turns at its largest value 1.5",
        "pose 1: turn turns at its smallest value 1.5",
        "pose 2: it ends, at turn = 1.25",
    ]
    assert unproved[1] == "0 of them proved to be alone; worst scaled residual 2e-15"
    assert lines("turn", SimpleNamespace(**{**path, "t": np.zeros(0)})) == ["it ends"]


def test_a_path_is_told_by_its_turning_points(command):
    code, out, _ = command("follow", limited())
    limit = LIMITED.input_range()[0][1]
    lines = out.splitlines()[-5:]

    assert code == 0
    assert [line.split(":")[1].split(" value ")[0] for line in lines[2:4]] == [
        " driver turns at its largest",
        " driver turns at its smallest",
    ]
    assert [abs(float(line.split()[-1])) for line in lines[2:4]] == pytest.approx([limit, limit], abs=1e-14)
    assert lines[-1].endswith("the path closes, at driver = 0")


def test_the_poses_of_a_path_are_a_table_or_a_file(command, tmp_path):
    _, out, _ = command("follow", limited())
    command("follow", limited(), "--csv", str(tmp_path / "path.csv"))
    header, *rows = (tmp_path / "path.csv").read_text(encoding="utf-8").splitlines()
    poses = [line for line in out.splitlines() if line.startswith("│")]

    assert header.startswith("pose,driver [rad],proved radius,crank.x [m]")
    assert len(rows) == len(poses)
    assert float(rows[-1].split(",")[1]) == pytest.approx(0.0, abs=1e-15)


def test_a_path_as_json_is_its_poses_with_tangents_events_and_radii(command):
    code, out, _ = command("follow", limited(), "--json", "--backwards", "--until", "-1", "1")
    path = json.loads(out)

    assert code == 0
    assert path["end"] == "range"
    assert path["t"][-1] == -1.0
    assert [row[2] for row in path["bodies"]["crank"]["q"]] == pytest.approx(path["t"], abs=1e-15)
    assert max(path["certified_radius"]) < 1e-12
    assert all(tangent["bodies"]["crank"][2] == pytest.approx(tangent["t"], abs=1e-15) for tangent in path["tangents"])


def test_a_bifurcation_as_json_has_both_tangents(command):
    code, out, _ = command("follow", CHANGE_POINT.scene(samples=3), "--json")
    (event,) = json.loads(out)["events"]

    assert code == 0
    assert event["kind"] == "bifurcation"
    assert event["t"] == pytest.approx(math.pi, abs=1e-14)
    assert len(event["tangents"]) == 2


def test_through_goes_straight_on_at_bifurcations(command):
    words = ("follow", "--json", "--through", "--until", "0", "7")
    path = json.loads(command(words[0], CHANGE_POINT.scene(samples=3), *words[1:]).stdout)

    assert path["t"][-1] == 7.0


def test_a_path_without_a_start_says_why(command):
    code, out, _ = command("follow", beyond())

    assert code == 1
    assert "cannot meet" in out


def test_a_path_that_runs_out_of_points_is_not_done(command):
    assert command("follow", limited(), "--most-points", "9").returncode == 1


def test_a_regular_scene_is_diagnosed_so(command):
    code, out, _ = command("diagnose", limited())

    assert code == 0
    assert "regular: the pose is proved to be alone" in out


def test_a_screw_whose_coordinate_no_body_has_is_diagnosed(command):
    code, out, _ = command("diagnose", ScrewJack(0.1).scene(samples=2))

    assert (code, "regular: the pose is proved to be alone" in out) == (0, True)


def test_a_diagnosis_as_json_has_the_same_words(command):
    code, out, _ = command("diagnose", dead_centre(), "--json")
    data = json.loads(out)

    assert code == 1
    assert data["kind"] == "turning point"
    assert data["bodies"] == ["crank", "connecting_rod"]
    assert data["other_driver"] == "the angle of crank"
    assert data["verdict"] == "singular"


def test_a_scene_without_a_pose_is_diagnosed_by_its_verdict(command):
    code, out, _ = command("diagnose", beyond(), "--json")

    assert code == 1
    assert json.loads(out)["verdict"] == refkin.Status.UNASSEMBLABLE.value


def told(command, scene, *words):
    """The exit code of `mobility` and the lines it prints."""
    said = command("mobility", scene, *words)
    return said.returncode, said.stdout.splitlines()


def slider_crank(**more):
    return refkin.SliderCrank(0.2, 0.35).scene(samples=2, **more)


def with_pin(scene, **ends):
    again = Revolute(name="again", **ends)
    return remade(scene, joints=(*scene.mechanism.joints, again))


def test_a_slider_crank_is_a_mechanism_with_one_freedom(command):
    code, lines = told(command, slider_crank())

    assert code == 0
    assert lines[0] == "by count: 3 x 4 bodies - 11 equations, 3 of them the ground's, = 1, mechanism with one freedom"
    assert lines[1].startswith("by rank at t = 0: 9 coordinates - rank 8 = 1, mechanism with one freedom")
    assert lines[2].startswith("drivers leave 0 of these free")


def test_redundant_rows_are_named_with_those_they_depend_on(command):
    ends = {"body_i": GROUND, "point_i": (0.0, 0.0), "body_j": "crank", "point_j": (-0.1, 0.0)}
    code, lines = told(command, with_pin(slider_crank(), **ends))

    assert code == 0
    assert lines[0].endswith("= -1, overconstrained: 1 equation more than coordinates")
    assert [line for line in lines if line.startswith("redundant")] == [
        "redundant: again[0] depends on A0[0]",
        "redundant: again[1] depends on A0[1]",
    ]


def test_a_driver_that_holds_nothing_at_a_dead_centre_is_named(command):
    code, lines = told(command, dead_centre())

    assert code == 0
    assert "a driver that holds nothing here: driver depends on A0[0], A[0], B[0]" in lines
    assert any(line.startswith("drivers leave 1 of these free") for line in lines)


def test_a_structure_is_called_by_that_name(command):
    """The slider pinned where it stands: then its driver says nothing new, and nothing can move."""
    scene = slider_crank(start=1.0)
    x, y, _ = refkin.solve(scene)["slider"].q[:, 0]
    ends = {"body_i": GROUND, "point_i": (float(x), float(y)), "body_j": "slider", "point_j": (0.0, 0.0)}
    code, lines = told(command, with_pin(scene, **ends))

    assert code == 0
    assert lines[1].startswith("by rank at t = 0: 9 coordinates - rank 9 = 0, structure")


def too_far():
    scene = refkin.SliderCrank(0.2, 0.35).scene(driven="slider", law=Polynomial(coefficients=(0.5,)), times=[0.0])
    return with_law(scene, Polynomial(coefficients=(0.6,)))


def test_without_a_pose_there_is_a_count_and_no_rank(command):
    code, lines = told(command, too_far())

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
def test_what_spins_passively_is_named_by_count_and_by_rank_in_text_and_in_json(name, command):
    scene, by_count, by_rank, passive = OF_SPACE[name]
    code, lines = told(command, scene)
    _, (text,) = told(command, scene, "--json")
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


def test_without_a_pose_json_says_why_and_gives_no_rank(command):
    code, (text,) = told(command, too_far(), "--json")

    assert code == 1
    assert json.loads(text)["by_rank"] is None
    assert "gap" in json.loads(text)["message"]


def test_every_operation_is_printed_and_counted(command):
    code, out, _ = command("program", SCENE)
    counts = program_of(refkin.load(SCENE)).counts()

    assert code == 0
    for segment, count in counts.items():
        assert re.search(rf"^{segment} +{count}\b", out, re.MULTILINE)
    assert re.search(rf"^all +{sum(counts.values())}$", out, re.MULTILINE)
    assert "x, y, phi of slider" in out


def test_counts_alone_are_five_lines(command):
    code, out, _ = command("program", SCENE, "--counts")

    assert (code, len(out.splitlines())) == (0, 5)


def test_a_scene_without_a_program_says_why(command):
    """Drivers hold the x of the crank three times over, and its pin is gone."""
    scene = ROCKER.scene(samples=2)
    drivers = tuple(XDriver(name=f"m{k}", body="crank", law=Polynomial(coefficients=(0.0,))) for k in range(3))
    code, out, _ = command("program", remade(scene, joints=scene.mechanism.joints[1:], drivers=drivers))

    assert code == 1
    assert "no program" in out
