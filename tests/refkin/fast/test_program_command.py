"""`crosscheck program`: the operations of a scene, for a person."""

from __future__ import annotations

import re
from pathlib import Path

from refkin.fast import program_of
from refkin.scenes.files import load

EXAMPLES = Path(__file__).parents[3] / "examples"
SCENE = EXAMPLES / "slider-crank.toml"


def test_every_operation_is_printed_and_counted(command):
    code, out, _ = command("program", SCENE)
    counts = program_of(load(SCENE)).counts()

    assert code == 0
    for segment, count in counts.items():
        assert re.search(rf"^{segment} +{count}\b", out, re.MULTILINE)
    assert re.search(rf"^all +{sum(counts.values())}$", out, re.MULTILINE)
    assert "x, y, phi of slider" in out


def test_counts_alone_are_five_lines(command):
    code, out, _ = command("program", SCENE, "--counts")

    assert (code, len(out.splitlines())) == (0, 5)


def test_a_scene_without_a_program_says_why(command, tmp_path):
    text = (EXAMPLES / "crank-rocker.toml").read_text(encoding="utf-8")
    driver = re.search(r"\[\[driver\]\].*?(?=\n\[\[|\Z)", text, re.DOTALL).group()
    joint = re.search(r"\[\[joint\]\].*?(?=\n\[\[|\Z)", text, re.DOTALL).group()
    crank = re.search(r'^body = "(\w+)"', driver, re.MULTILINE).group(1)
    law = 'law = { kind = "polynomial", coefficients = [0.0] }'
    drivers = "\n".join(f'[[driver]]\nname = "m{k}"\ntype = "x"\nbody = "{crank}"\n{law}' for k in range(3))
    path = tmp_path / "scene.toml"
    path.write_text(text.replace(driver, drivers).replace(joint, ""), encoding="utf-8")
    code, out, _ = command("program", path)

    assert code == 1
    assert "no program" in out
