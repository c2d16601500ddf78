"""Scene files: what is written is read back bit for bit; what is wrong is named, all of it at once."""

from __future__ import annotations

import copy
import json
import tomllib
from types import SimpleNamespace

import pytest

from refkin.errors import Fault, InvalidScene
from refkin.scenes import keys
from refkin.scenes.explained import unconnected
from refkin.scenes.files import load, parse, to_dict, to_toml
from refkin.scenes.keys import schema
from tests.places import EXAMPLES, ROOT

DRIVEN = 'law = { kind = "polynomial", coefficients = [0.0, 2.0] }'
GRID = "start = 0.0\nstop = 1.0\ncount = 3"
POINT = '[[point]]\nname = "P"\nbody = "coupler"\nposition = [0.3, 0.2]\n'
TEXT = (EXAMPLES / "crank-rocker.toml").read_text(encoding="utf-8") + POINT
for old, new in (
    ("start = 0.0\nstop = 6.283185307179586\ncount = 73", GRID),
    ('effects = ["acceleration", "velocity"]', 'effects = ["velocity"]'),
    ('evidence = ["certificate", "condition"]', 'bodies_wanted = ["coupler"]'),
    ('law = { coefficients = [0.0, 1.0], kind = "polynomial" }', DRIVEN),
):
    assert old in TEXT
    TEXT = TEXT.replace(old, new)
GOOD = tomllib.loads(TEXT)
SLOW = {"kind": "sinusoid", "amplitude": 1.0, "angular_frequency": -5e-324}
TABLE = {"kind": "table", "argument": [0.0, 1.0], "value": [0.0, 1.0]}


def put(*path_and_value):
    """Return a change: set, or with `...` delete, what stands at a path."""
    *path, value = path_and_value

    def change(data):
        for key in path[:-1]:
            data = data[key]
        if value is ...:
            del data[path[-1]]
        else:
            data[path[-1]] = value

    return change


CLOSE = 'law = { kind = "table", argument = [0.0, 5e-324, 1e-323, 1.0], value = [0.0, 1.0, 2.0, 0.0] }'
HOSTILE = {
    "an integer that Python does not read": (("schema = 1", "schema = " + "9" * 5000), {"file"}),
    "an integer beyond every float": (("[0.5, 0.0", "[0x" + "f" * 5000 + ", 0.0"), {"body[0].estimate[0]"}),
    "a list in a list in a list ...": (("schema = 1", "schema = 1\nx = " + "[" * 100_000 + "]" * 100_000), {"file"}),
    "a list nested 300 deep": (("[0.5, 0.0, 0.0]", "[" * 300 + "]" * 300), None),
    "a date for a name": (('"crank-rocker"', "2020-01-01"), {"name"}),
    "a date for a number": (("[0.5, 0.0", "[2020-01-01, 0.0"), {"body[0].estimate[0]"}),
    "a table too close for a spline": ((DRIVEN, CLOSE), {"driver[0].law.argument"}),
    "a stop at infinity": ((GRID, "start = 0.0\nstop = inf\ncount = 5"), {"times.stop"}),
    "a span that overflows": ((GRID, "start = -1.7e308\nstop = 1.7e308\ncount = 5"), {"times.stop"}),
    "a time that is no number": ((GRID, "values = [0.0, nan]"), {"times"}),
}
BROKEN = {
    "no schema": (put("schema", ...), "schema: "),
    "another schema": (put("schema", 2), "schema: expected 1, got 2"),
    "schema as a truth value": (put("schema", True), "schema: expected 1, got True"),
    "schema as a float": (put("schema", 1.0), "schema: expected 1, got 1.0"),
    "no such dimension": (put("dimension", "solid"), "dimension: expected 'planar' or 'spatial', got 'solid'"),
    "planar joints in space": (put("dimension", "spatial"), "driver[0].joint: expected this key"),
    "unknown key": (put("bodys", 1), "bodys: expected no such key"),
    "unknown effect": (put("effects", ["velocty"]), "effects[0]: "),
    "unknown evidence": (put("evidence", ["proof"]), "evidence[0]: "),
    "unknown body wanted": (put("bodies_wanted", ["link"]), "bodies_wanted[0]: "),
    "no body wanted": (put("bodies_wanted", []), "bodies_wanted: "),
    "no times": (put("times", ...), "times: "),
    "half a grid": (put("times", "count", ...), "times.count: "),
    "grid and values": (put("times", "values", [0.0, 1.0]), "times.start: "),
    "times backwards": (put("times", {"values": [1.0, 0.5]}), "times: expected strictly increasing times"),
    "stop before start": (put("times", "stop", -1.0), "times.stop: "),
    "count zero": (put("times", "count", 0), "times.count: "),
    "count not whole": (put("times", "count", 2.5), "times.count: "),
    "count beyond reason": (put("times", "count", 10**12), "times.count: "),
    "no body": (put("body", []), "body: "),
    "name twice": (put("body", 1, "name", "crank"), "body[1].name: expected a name not used before, got 'crank'"),
    "empty name": (put("joint", 0, "name", ""), "joint[0].name: "),
    "body called ground": (put("body", 0, "name", "ground"), "body[0].name: "),
    "point named like a body": (
        put("point", [{"name": "coupler", "body": "crank", "position": [1.0, 0.0]}]),
        "point[0].name: expected a name not used before, got 'coupler'",
    ),
    "driver named like a joint": (put("driver", 0, "name", "A0"), "driver[0].name: "),
    "estimate too short": (put("body", 0, "estimate", [0.5, 0.0]), "body[0].estimate"),
    "unknown joint type": (put("joint", 0, "type", "revolut"), "joint[0].type: "),
    "no joint type": (put("joint", 0, "type", ...), "joint[0].type: "),
    "unknown body in joint": (put("joint", 1, "body_i", "crnk"), "joint[1].body_i: expected a body of the scene"),
    "body against itself": (put("joint", 1, "body_j", "crank"), "joint[1]: expected two different bodies, got 'crank'"),
    "point missing": (put("joint", 1, "point_i", ...), "joint[1].point_i: "),
    "point as text": (put("joint", 1, "point_i", [0.5, "0"]), "joint[1].point_i[1]: expected a number, got '0'"),
    "three components": (put("joint", 1, "point_i", [0.5, 0.0, 0.0]), "joint[1].point_i: expected 2 numbers"),
    "not finite": (put("joint", 1, "point_i", [float("nan"), 0.0]), "joint[1].point_i[0]: expected a finite number"),
    "key of another joint": (put("joint", 1, "length", 2.0), "joint[1].length: expected no such key"),
    "axis zero": (
        put("joint", 0, {**GOOD["joint"][0], "type": "prismatic", "axis_i": [0.0, 0.0]}),
        "joint[0].axis_i: expected a vector that is not zero",
    ),
    "length zero": (put("joint", 0, {**GOOD["joint"][0], "type": "distance", "length": 0.0}), "joint[0].length: "),
    "no driver": (put("driver", []), "driver: expected 1 more constraint: add drivers"),
    "unknown driver": (put("driver", 0, "type", "torque"), "driver[0].type: "),
    "no law": (put("driver", 0, "law", ...), "driver[0].law: expected either `law` or `rate_law`"),
    "two laws": (put("driver", 0, "rate_law", TABLE), "driver[0].law: expected either `law` or `rate_law`"),
    "initial beside a law": (put("driver", 0, "initial", 1.0), "driver[0].initial: "),
    "unknown law": (put("driver", 0, "law", "kind", "poly"), "driver[0].law.kind: "),
    "no coefficients": (put("driver", 0, "law", "coefficients", []), "driver[0].law.coefficients: "),
    "a wave too slow to be integrated": (put("driver", 0, "law", SLOW), "driver[0].law.angular_frequency: expected 0"),
    "table too short": (put("driver", 0, "law", {**TABLE, "argument": [0.0, 0.5]}), "driver[0].law.argument: "),
    "table backwards": (put("driver", 0, "law", {**TABLE, "argument": [1.0, 0.0]}), "driver[0].law.argument: "),
    "table uneven": (put("driver", 0, "law", {**TABLE, "value": [0.0]}), "driver[0].law.value: "),
    "point of no body": (put("point", 0, "body", "couple"), "point[0].body: "),
    "body not a list": (put("body", 3), "body: "),
}


def refused(data, source="scene"):
    """Return the error with which a scene is refused."""
    with pytest.raises(InvalidScene) as result:
        parse(data, source)
    return result.value


def refused_file(path, text):
    """Return the error with which a file of some text is refused."""
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidScene) as result:
        load(path)
    return result.value


def messages(data):
    return str(refused(data, "scene.toml")).splitlines()


@pytest.mark.parametrize(("change", "told"), BROKEN.values(), ids=BROKEN.keys())
def test_each_broken_scene_gets_one_clear_message(change, told):
    data = copy.deepcopy(GOOD)
    change(data)
    lines = messages(data)

    assert sum(line.startswith(f"scene.toml: {told}") for line in lines) == 1, lines


PLANTED = {
    "key": (put("bodys", 1), "bodys"),
    "type of times": (put("times", [0.0, 1.0]), "times"),
    "estimate of two numbers": (put("body", 0, "estimate", [0.5, 0.0]), "body[0].estimate"),
    "name twice": (put("joint", 2, "name", "A"), "joint[2].name"),
    "unknown type of joint": (put("joint", 0, "type", "revolut"), "joint[0].type"),
    "unknown body of that joint": (put("joint", 0, "body_i", "grund"), "joint[0].body_i"),
    "key that is missing": (put("joint", 1, "point_i", ...), "joint[1].point_i"),
    "number that is text": (put("joint", 2, "point_i", [1.75, "0"]), "joint[2].point_i[1]"),
    "unknown body": (put("joint", 2, "body_i", "couplr"), "joint[2].body_i"),
    "number that is not finite": (put("joint", 2, "point_j", [float("nan"), 0.0]), "joint[2].point_j[0]"),
    "no coefficients": (put("driver", 0, "law", "coefficients", []), "driver[0].law.coefficients"),
    "point of no body": (put("point", 0, "body", "couple"), "point[0].body"),
}
PLANTED_IN_SPACE = {
    "three numbers for seven": (put("body", 0, "estimate", [0.0, 0.0, 0.0]), "body[0].estimate"),
    "type of times": (put("times", []), "times"),
    "effect": (put("effects", ["jerk"]), "effects[0]"),
    "form": (put("joint", 0, "form", "quarter"), "joint[0].form"),
    "two numbers for three": (put("joint", 0, "point_i", [0.0, 0.0]), "joint[0].point_i"),
    "axis without direction": (put("joint", 0, "axis_i", [0.0, 0.0, 0.0]), "joint[0].axis_i"),
    "zero along its axis": (put("joint", 0, "zero_j", [0.0, 0.0, 2.0]), "joint[0].zero_j"),
    "pitch": (put("joint", 1, "pitch", 0.0), "joint[1].pitch"),
    "unknown body": (put("joint", 1, "body_j", "nobody"), "joint[1].body_j"),
    "joint that there is not": (put("driver", 0, "joint", "X"), "driver[0].joint"),
    "planar type": (put("joint", 2, "type", "cam"), "joint[2].type"),
}
HINGE = {"point_i": [0.0, 0.0, 0.0], "axis_i": [0.0, 0.0, 1.0], "zero_i": [1.0, 0.0, 0.0]}
HINGE |= {"point_j": [0.0, 0.0, 0.0], "axis_j": [0.0, 0.0, 1.0], "zero_j": [1.0, 0.0, 0.0]}
SPACE = {
    **{"schema": 1, "dimension": "spatial", "effects": ["velocity"], "times": {"values": [0.0, 1.0]}},
    "body": [{"name": "a"}, {"name": "b"}, {"name": "c"}],
    "joint": [
        {"name": "R", "type": "revolute", "body_i": "ground", "body_j": "a", **HINGE},
        {"name": "H", "type": "screw", "body_i": "a", "body_j": "b", "pitch": 0.5, **HINGE},
        {"name": "S", "type": "spherical", "body_i": "b", "body_j": "c"}
        | {"point_i": [1.0, 0.0, 0.0], "point_j": [0.0, 0.0, 0.0]},
    ],
    "driver": [{"name": "D", "type": "angle", "joint": "R", "law": {"kind": "polynomial", "coefficients": [1.0]}}],
}


@pytest.mark.parametrize(("good", "planted"), [(GOOD, PLANTED), (SPACE, PLANTED_IN_SPACE)], ids=["plane", "space"])
def test_a_file_with_a_fault_of_every_kind_names_them_all_and_no_others(good, planted):
    """Of structure and of value, also two in one joint, one of each kind."""
    data = copy.deepcopy(good)
    for change, _ in planted.values():
        change(data)

    assert sorted(fault.path for fault in refused(copy.deepcopy(data)).faults) == sorted(
        path for _, path in planted.values()
    )


def test_what_a_wrong_key_may_bring_about_is_not_told():
    """Whether a driver is missing, and what dimension it is, follows from other faults."""
    data = copy.deepcopy(GOOD)
    for name in ("no such dimension", "unknown joint type", "unknown law", "point of no body", "stop before start"):
        BROKEN[name][0](data)
    data["joint"][3]["body_i"] = "rcker"
    result = "\n".join(messages(data))

    for part in ("dimension", "joint[0].type", "driver[0].law.kind", "point[0].body", "times.stop", "joint[3].body_i"):
        assert part in result
    assert "add drivers" not in result


def test_a_scene_is_written_and_read_back_bit_for_bit():
    scene = parse(GOOD)

    assert parse(tomllib.loads(to_toml(scene))) == scene
    assert parse(json.loads(json.dumps(to_dict(scene)))) == scene


def test_a_name_of_any_character_is_written_so_that_toml_reads_it():
    scene = parse(GOOD | {"name": '\U0001f600 \x7f \x01 \t \n " \\ \u0171'})

    assert parse(tomllib.loads(to_toml(scene))) == scene


def test_an_example_reads_as_it_stands():
    scene = parse(GOOD)

    assert scene.times == (0.0, 0.5, 1.0)
    assert scene.wanted == ("coupler",)
    assert scene.effects == {"velocity"}
    assert scene.evidence == {"condition", "certificate"}


@pytest.mark.parametrize(("name", "text"), [("a.toml", "schema = = 1"), ("a.json", "{"), ("a.json", "[1, 2]")])
def test_text_that_is_no_scene_file_is_refused_in_one_line(tmp_path, name, text):
    assert len(refused_file(tmp_path / name, text).faults) == 1


def test_a_key_twice_in_a_json_file_is_refused_as_in_toml(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(GOOD)[:-1] + ', "name": "another"}', encoding="utf-8")
    with pytest.raises(InvalidScene, match=r"a\.json: file: expected .* got \"the key 'name' twice in one object\""):
        load(path)


def test_a_message_holds_no_control_character_of_a_file():
    data = copy.deepcopy(GOOD)
    data["body"][0]["name"] = "cr\x1b[31mank\n"
    data["bo\x1b[2Jdy"] = 1
    lines = messages(data)

    assert all(line.isprintable() for line in lines)
    assert any("a body of the scene: ground, cr\\x1b[31mank\\n, coupler" in line for line in lines)


@pytest.mark.parametrize(
    ("before", "after", "paths"),
    [
        ("crank-rocker", r"\ud800", ["name"]),
        ('"name": "crank-rocker"', r'"\udfff": 1', ["\udfff"]),
        ('"crank"', r'"cr\ud800nk"', ["body[0].name", "joint[0].body_j", "joint[1].body_i", "driver[0].body"]),
    ],
    ids=["name", "key", "body, and who names it"],
)
def test_half_of_a_character_is_one_fault_wherever_it_stands(tmp_path, before, after, paths):
    """JSON lets it pass as an escape, and no text holds it: that ended in a traceback."""
    error = refused_file(tmp_path / "a.json", json.dumps(GOOD).replace(before, after))
    lines = str(error).splitlines()

    assert [fault.path for fault in error.faults] == paths
    assert all(line.isprintable() and "half of a character (a lone surrogate), got '" in line for line in lines)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("null", "file: expected a table of keys, not null"),
        (json.dumps({**GOOD, "effects": None}), "effects: expected a list, not null"),
        (json.dumps({**GOOD, "body": None}), "body: expected a list: each body under a header [[body]], not null"),
    ],
)
def test_null_where_something_has_to_stand_is_named(tmp_path, text, said):
    path = tmp_path / "a.json"

    assert f"{path}: {said}" in str(refused_file(path, text)).splitlines()


@pytest.mark.parametrize("key", ["point_i", "point_j"])
def test_a_point_beyond_all_distances_is_a_fault_of_its_numbers(key):
    """The distance of two such points is no float: that ended in a traceback, or in a warning of NumPy's."""
    data = copy.deepcopy(GOOD)
    data["joint"][0][key] = [1e308, -1e308]
    lines = messages(data)

    assert [line.split(",")[0] for line in lines] == [
        f"scene.toml: joint[0].{key}[{k}]: expected a finite number of at most 1e+300 in size" for k in (0, 1)
    ]
    data["joint"][0][key] = [1e300, -1e300]
    assert parse(data).mechanism.size() > 1e299


def test_times_out_of_order_are_told_beside_a_joint_that_cannot_be_read():
    data = copy.deepcopy(GOOD)
    data["times"] = {"values": [1.0, 0.0]}
    data["joint"][0]["type"] = "revolut"
    lines = messages(data)

    assert any("times" in line and "strictly increasing" in line for line in lines)
    assert any("joint[0]" in line and "revolut" in line for line in lines)


def test_a_file_that_is_not_there_and_one_that_is_not_text_are_named(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"a = 1\n\n\xff\xfe\x00")
    for path in (tmp_path / "absent.toml", tmp_path / "binary.toml", tmp_path):
        with pytest.raises(InvalidScene, match=path.name) as refused:
            load(path)
        assert ("line 3" in str(refused.value)) == (path.name == "binary.toml")


def test_the_schema_knows_how_many_coordinates_a_body_has_in_the_plane_and_in_space():
    parts = schema()["$defs"]
    counts = {}
    for name in ("planarBody", "spatialBody", "planarPoint", "spatialPoint"):
        value = parts[name]["properties"]["estimate" if "Body" in name else "position"]
        value = value.get("anyOf", [value])[0]
        counts[name] = value["minItems"], value["maxItems"]

    assert counts == {"planarBody": (3, 3), "spatialBody": (7, 7), "planarPoint": (2, 2), "spatialPoint": (3, 3)}
    assert parts["SceneFile"]["properties"]["body"]["items"] == {"$ref": "#/$defs/planarBody"}
    assert parts["SpatialSceneFile"]["properties"]["body"]["items"] == {"$ref": "#/$defs/spatialBody"}


def test_the_schema_names_every_joint_and_profile():
    text = json.dumps(schema())
    of_contacts = "gear", "rack_and_pinion", "cam", "disc", "polar", "offset_law"

    for kind in ("revolute", "prismatic", "point_on_line", "distance", "fixed", "angle", *of_contacts):
        assert f'"{kind}"' in text


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_gets_its_faults_and_no_others(kind, tmp_path):
    """Each fault once, under its own key; no traceback, and nothing that follows from a fault named already."""
    change, expected = HOSTILE[kind]
    paths = [fault.path for fault in refused_file(tmp_path / "scene.toml", TEXT.replace(*change, 1)).faults]

    assert len(paths) == len(set(paths))
    assert expected is None or set(paths) == expected


def test_json_nested_without_end_is_a_fault(tmp_path):
    scene = tmp_path / "scene.json"
    scene.write_text("[" * 100_000)
    with pytest.raises(InvalidScene):
        load(scene)


def test_a_long_value_is_not_quoted_whole():
    assert len(str(Fault("times", [0.0] * 100_000, "strictly increasing times"))) < 300


@pytest.mark.parametrize(
    ("change", "paths"),
    [
        ({"point_i": [0.0, "x", 1.0]}, {"joint[0].point_i", "joint[0].point_i[1]"}),
        ({"type": "revolut", "point_i": [0.0, "x"]}, {"joint[0].type", "joint[0].point_i[1]"}),
        ({"type": "revolut", "pitch": 1.0}, {"joint[0].type"}),
        ({"type": "revolut", "name": ["pin"]}, {"joint[0].type", "joint[0].name"}),
    ],
)
def test_what_cannot_be_read_as_a_whole_is_looked_into(change, paths):
    data = copy.deepcopy(GOOD)
    data["joint"][0] |= change

    assert {fault.path for fault in refused(data).faults} == paths


def test_of_a_joint_that_cannot_be_read_only_what_stands_in_the_file_is_said():
    """That its name was '' was said, too, of a name that is not there."""
    rocker = tomllib.loads((ROOT / "examples/crank-rocker.toml").read_text())
    error = refused({**rocker, "body": "x", "joint": [{}]})

    assert {fault.path for fault in error.faults} == {"body", "joint[0].type"}


def test_an_integer_beyond_every_float_is_quoted_as_it_stands():
    data = copy.deepcopy(GOOD)
    data["joint"][0]["point_i"] = [-(10**400), 0.0]

    assert any("joint[0].point_i[0]" in line and "-1" + "0" * 100 in line for line in messages(data))


def test_a_file_with_a_fault_in_each_of_many_joints_is_not_read_anew_for_each(monkeypatch):
    read, data = [], tomllib.loads(TEXT)
    data["joint"] = [{"name": f"J{k}", "type": "fixed", "body_i": "ground", "body_j": "crank"} for k in range(40)]
    monkeypatch.setattr(keys, "_read", lambda file, own=keys._read: read.append(file) or own(file))
    assert len(refused(data).faults) >= 80
    assert len(read) < 60


@pytest.mark.parametrize(("bodies", "looked_for"), [(99, True), (101, False)])
def test_beside_more_faults_than_are_told_no_further_ones_are_looked_for(bodies, looked_for, monkeypatch):
    """A thousand bodies without a name took a quarter of a minute."""
    asked, data = [], copy.deepcopy(GOOD)
    data["body"] = [{} for _ in range(bodies)]
    monkeypatch.setattr(keys, "_filled", lambda *given, own=keys._filled: asked.append(given) or own(*given))

    assert len(refused(data).faults) >= bodies
    assert bool(asked) is looked_for


def test_a_message_tells_the_first_hundred_of_ten_thousand_faults():
    error = InvalidScene([Fault(f"body[{k}]", None, "a name") for k in range(10_000)], "many.toml")
    assert len(error.faults) == 10_000
    assert str(error).splitlines()[99:] == ["many.toml: body[99]: expected a name", "many.toml: 9900 more faults"]


def test_a_chain_of_bodies_is_tied_to_the_ground_whatever_their_order():
    pairs = [("ground" if k == 0 else f"b{k - 1}", f"b{k}") for k in range(500)]
    bodies = [SimpleNamespace(name=name) for name in ("alone", *(b for _, b in reversed(pairs)))]
    loose = unconnected(bodies, [SimpleNamespace(bodies=pair) for pair in reversed(pairs)])
    assert [fault.value for fault in loose] == ["alone"]
