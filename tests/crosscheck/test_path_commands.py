"""`crosscheck follow` and `crosscheck diagnose`: what they print, and their exit codes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.commands.follow import lines
from refkin import FourBar, Polynomial, SliderCrank
from refkin.scenes.linkages import ScrewJack
from refkin.solving.follow import TurningPoint

LIMITED = FourBar(ground=0.9, crank=0.3, coupler=0.6, rocker=0.45)
CHANGE_POINT = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5)


def limited():
    return LIMITED.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.0, 0.5))


def beyond():
    """A crank beyond its limit at the first time."""
    m = limited().mechanism
    law = Polynomial(coefficients=(2.5, 1.0))
    return replace(limited(), mechanism=replace(m, drivers=(replace(m.drivers[0], law=law),)), times=(0.0,))


def dead_centre():
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
