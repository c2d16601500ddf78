"""Gears, racks, cams and offset pins in scene files: what is wrong with them is named."""

from __future__ import annotations

import copy

import pytest

from refkin.errors import InvalidScene
from refkin.scenes.files import parse, to_dict

from .contact_cases import scene


def change(name, joint, **keys):
    """The data of a case's scene file with some keys of a joint set, or with `...` left out."""
    data = copy.deepcopy(to_dict(scene(name)))
    for key, value in keys.items():
        data["joint"][joint][key] = value
        if value is ...:
            del data["joint"][joint][key]
    return data


BAD_LAW = {"kind": "table", "argument": [0.0, 1.0], "value": [0.0]}
HALF = {"kind": "table", "argument": [0.0, 2.0, 5.0], "value": [1.0, 1.5, 1.0], "periodic": True}
BROKEN = {
    "a face without normal": (("disc under plate", 2, {"normal_j": ...}), "joint[2].normal_j: expected the normal of"),
    "a normal without direction": (("plate over lobes", 2, {"normal_j": [0.0, 0.0]}), "joint[2].normal_j: "),
    "a normal without face": (("tip on disc", 2, {"normal_j": [0.0, 1.0]}), "joint[2].normal_j: expected no normal"),
    "a roller without radius": (("roller over disc", 2, {"roller_radius": ...}), "joint[2].roller_radius: "),
    "a roller of no radius": (("roller over lobes", 2, {"roller_radius": 0.0}), "joint[2].roller_radius: "),
    "a radius without roller": (
        ("tip on lobes", 2, {"roller_radius": 0.5}),
        "joint[2].roller_radius: expected no roller",
    ),
    "an unknown follower": (("tip on disc", 2, {"follower": "knife"}), "joint[2].follower: "),
    "a disc of no radius": (
        ("tip on disc", 2, {"profile": {"kind": "disc", "radius": 0.0}}),
        "joint[2].profile.radius: expected a radius above 0",
    ),
    "an unknown profile": (("tip on disc", 2, {"profile": {"kind": "ellipse"}}), "joint[2].profile.kind: "),
    "a profile without law": (("tip on lobes", 2, {"profile": {"kind": "polar"}}), "joint[2].profile.law: "),
    "a disc with a law": (
        ("tip on disc", 2, {"profile": {"kind": "disc", "radius": 1.0, "law": BAD_LAW}}),
        "joint[2].profile.law: expected no such key",
    ),
    "a profile that is no table": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": BAD_LAW}}),
        "joint[2].profile.law.value: ",
    ),
    "a profile that is not round": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": HALF}}),
        "joint[2].profile.law.argument: expected a period of 6.283185307179586 or of a whole part of it, got 5.0",
    ),
    "a profile that repeats itself after more than all numbers": (
        ("tip on lobes", 2, {"profile": {"kind": "polar", "law": {**HALF, "argument": [-1e308, 0.0, 1e308]}}}),
        "joint[2].profile.law.argument: expected a period of 6.283185307179586 or of a whole part of it, got inf",
    ),
    "a contact on a disc": (("tip on disc", 2, {"contact_estimate": 1.0}), "joint[2].contact_estimate: "),
    "a wheel of no radius": (("gear train", 3, {"radius_j": 0.0}), "joint[3].radius_j: "),
    "a pinion of no radius": (("rack above", 2, {"radius": 0.0}), "joint[2].radius: "),
    "a rack without direction": (("rack above", 2, {"axis_i": [0.0, 0.0]}), "joint[2].axis_i: "),
    "half an offset": (("shifted rocker", 1, {"offset_law": [BAD_LAW]}), "joint[1].offset_law: expected 2 laws, not 1"),
    "an offset that is no table": (
        ("shifted rocker", 1, {"offset_law": [{"kind": "polynomial", "coefficients": [0.0]}, BAD_LAW]}),
        "joint[1].offset_law[1].value: ",
    ),
    "an offset that ends too soon": (
        ("shifted rocker", 1, {"offset_law": [{**BAD_LAW, "value": [0.0, 1.0]}] * 2}),
        "joint[1].offset_law[0].argument: expected a table from 0.0 to 2.0",
    ),
}


@pytest.mark.parametrize(("broken", "told"), BROKEN.values(), ids=BROKEN.keys())
def test_each_bad_combination_gets_one_clear_message(broken, told):
    name, joint, keys = broken
    with pytest.raises(InvalidScene) as result:
        parse(change(name, joint, **keys), "scene.toml")
    lines = str(result.value).splitlines()

    assert sum(line.startswith(f"scene.toml: {told}") for line in lines) == 1, lines


def test_a_polar_cam_brings_a_coordinate_that_counts_when_drivers_are_missing():
    data = to_dict(scene("plate over lobes"))
    del data["driver"]
    with pytest.raises(InvalidScene, match="expected 1 more constraint: add drivers"):
        parse(data)
