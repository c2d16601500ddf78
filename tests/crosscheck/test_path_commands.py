"""`crosscheck follow` and `crosscheck diagnose`: what they print, and their exit codes."""

from __future__ import annotations

import json
import math

import pytest

import refkin
from crosscheck.cli import main
from refkin import FourBar, Polynomial, SliderCrank
from refkin.scenes.files import to_toml
from refkin.scenes.linkages import ScrewJack

LIMITED = FourBar(ground=0.9, crank=0.3, coupler=0.6, rocker=0.45)
CHANGE_POINT = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5)


def told(tmp_path, capsys, scene, *words):
    """The exit code, and what was printed."""
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main([words[0], str(path), *words[1:]])
    return ended.value.code, capsys.readouterr()


def limited():
    return LIMITED.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.0, 0.5))


def dead_centre():
    law = Polynomial(coefficients=(0.75, -0.1))
    return SliderCrank(0.25, 0.5).scene(driven="slider", law=law, times=(0.0,))


def test_a_path_is_told_by_its_turning_points(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, limited(), "follow")
    limit = LIMITED.input_range()[0][1]
    lines = printed.out.splitlines()[-5:]

    assert code == 0
    assert [line.split(":")[1].split(" value ")[0] for line in lines[2:4]] == [
        " driver turns at its largest",
        " driver turns at its smallest",
    ]
    assert [abs(float(line.split()[-1])) for line in lines[2:4]] == pytest.approx([limit, limit], abs=1e-14)
    assert lines[-1].endswith("the path closes, at driver = 0")


def test_the_poses_of_a_path_are_a_table_or_a_file(tmp_path, capsys):
    _, printed = told(tmp_path, capsys, limited(), "follow")
    told(tmp_path, capsys, limited(), "follow", "--csv", str(tmp_path / "path.csv"))
    header, *rows = (tmp_path / "path.csv").read_text(encoding="utf-8").splitlines()
    poses = [line for line in printed.out.splitlines() if line.startswith("│")]

    assert header.startswith("pose,driver [rad],proved radius,crank.x [m]")
    assert len(rows) == len(poses)
    assert float(rows[-1].split(",")[1]) == pytest.approx(0.0, abs=1e-15)


def test_a_path_as_json_is_its_poses_with_tangents_events_and_radii(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, limited(), "follow", "--json", "--backwards", "--until", "-1", "1")
    path = json.loads(printed.out)

    assert code == 0
    assert path["end"] == "range"
    assert path["t"][-1] == -1.0
    assert [row[2] for row in path["bodies"]["crank"]["q"]] == pytest.approx(path["t"], abs=1e-15)
    assert max(path["certified_radius"]) < 1e-12
    assert all(tangent["bodies"]["crank"][2] == pytest.approx(tangent["t"], abs=1e-15) for tangent in path["tangents"])


def test_a_bifurcation_as_json_has_both_tangents(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, CHANGE_POINT.scene(samples=3), "follow", "--json")
    (event,) = json.loads(printed.out)["events"]

    assert code == 0
    assert event["kind"] == "bifurcation"
    assert event["t"] == pytest.approx(math.pi, abs=1e-14)
    assert len(event["tangents"]) == 2


def test_through_goes_straight_on_at_bifurcations(tmp_path, capsys):
    words = ("follow", "--json", "--through", "--until", "0", "7")
    path = json.loads(told(tmp_path, capsys, CHANGE_POINT.scene(samples=3), *words)[1].out)

    assert path["t"][-1] == 7.0


def test_a_driver_that_does_not_exist_is_a_usage_error(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, limited(), "follow", "--driver", "wheel")

    assert code == 2
    assert printed.err.strip() == "no driver is called 'wheel'; there are: driver"


def test_a_path_without_a_start_says_why(tmp_path, capsys):
    scene = LIMITED.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.0,))
    text = to_toml(scene).replace("coefficients = [0.0, 1.0]", "coefficients = [2.5, 1.0]")
    path = tmp_path / "beyond.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["follow", str(path)])

    assert ended.value.code == 1
    assert "cannot meet" in capsys.readouterr().out


def test_a_path_that_runs_out_of_points_is_not_done(tmp_path, capsys):
    assert told(tmp_path, capsys, limited(), "follow", "--most-points", "9")[0] == 1


def test_a_regular_scene_is_diagnosed_so(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, limited(), "diagnose")

    assert code == 0
    assert "regular: the pose is proved to be alone" in printed.out


def test_a_screw_whose_coordinate_no_body_has_is_diagnosed(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, ScrewJack(0.1).scene(samples=2), "diagnose")

    assert (code, "regular: the pose is proved to be alone" in printed.out) == (0, True)


def test_a_dead_centre_is_told_with_its_rows_bodies_and_another_driver(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, dead_centre(), "diagnose")

    assert code == 1
    assert "turning point: " in printed.out
    assert "rows: A0, A, B, driver" in printed.out
    assert "bodies: crank, connecting_rod" in printed.out
    assert "driven by the angle of crank the same pose is regular" in printed.out


def test_a_diagnosis_as_json_has_the_same_words(tmp_path, capsys):
    code, printed = told(tmp_path, capsys, dead_centre(), "diagnose", "--json")
    data = json.loads(printed.out)

    assert code == 1
    assert data["kind"] == "turning point"
    assert data["bodies"] == ["crank", "connecting_rod"]
    assert data["other_driver"] == "the angle of crank"
    assert data["verdict"] == "singular"


def test_a_scene_without_a_pose_is_diagnosed_by_its_verdict(tmp_path, capsys):
    text = to_toml(limited()).replace("coefficients = [0.0, 1.0]", "coefficients = [2.5, 1.0]")
    path = tmp_path / "beyond.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", str(path), "--json"])

    assert ended.value.code == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == refkin.Status.UNASSEMBLABLE.value
