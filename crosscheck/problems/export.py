"""The problem set as a folder: a folder per problem, an index, a grader.

======================== =================================================================================
`problems.json`          version, hash, and of each problem family, assembly and attainable digits
`NAME/scene.toml, .json` the scene, with rough estimates of the assembly that is meant
`NAME/model.xml`         MJCF
`NAME/exudyn_model.py`   a script for exudyn
`NAME/certified.json`    the answer in 30 digits, and the other assemblies
`grade.py`               scores answers
======================== =================================================================================

The hash is that of the certified answers, each of which holds that of its scene.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from crosscheck.errors import CannotRun
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.problems import VERSION, grader
from crosscheck.problems.exudyn_script import to_exudyn
from crosscheck.problems.mjcf import to_mjcf
from crosscheck.problems.statement import Draft, Problem
from crosscheck.workers.processes import Failure, call_in_turn
from refkin.scenes.files import to_dict, to_toml

LONGEST = 600.0
"""After this long at one problem a process is ended [s]: a hundred times what the longest takes."""
UNITS = {"planar": ("length",) * 2 + ("angle",), "spatial": ("length",) * 3 + ("Euler parameter",) * 4}
"""Of the coordinates of a body of the plane and of space."""
NEAREST = 8
"""Decimals, of sizes or radians, of other assemblies: they tell them apart, and no rounding reaches them."""


def export(
    folder: Path, asked: Sequence[Draft], processes: int = 1, progress: Callable[[int, int], None] | None = None
) -> str:
    """Write the problem set into a folder and return its hash.

    Parameters
    ----------
    folder : Path
        Made if it does not exist; files of a set that is there are overwritten.
    asked : sequence of Draft
        The problems; `drafts()` for all.
    processes : int
        How many prove answers side by side; with 1 this one does it.
    progress : callable
        Called with the number of problems that are done, and of all.
    """
    index, hashes = [], []
    folder.mkdir(parents=True, exist_ok=True)
    made = map(written, asked) if processes == 1 else call_in_turn(written, asked, LONGEST, processes)
    for done, answer in enumerate(made):
        if isinstance(answer, Failure):
            raise CannotRun(f"{asked[done].name}: {answer.name}; {answer.text}")
        entry, files = answer
        at = folder / entry["name"]
        at.mkdir(exist_ok=True)
        for name, text in files.items():
            (at / name).write_text(text, encoding="utf-8", newline="\n")
        hashes.append(sha256(files["certified.json"].encode()).digest())
        index.append(entry)
        if progress:
            progress(done + 1, len(asked))
    total = sha256(b"".join(hashes)).hexdigest()
    head = {"set": "crosscheck problems", "version": VERSION, "sha256": total, "problems": index}
    (folder / "problems.json").write_text(json.dumps(head, indent=1) + "\n", encoding="utf-8", newline="\n")
    grade = Path(grader.__file__).read_text(encoding="utf-8")
    (folder / "grade.py").write_text(grade, encoding="utf-8", newline="\n")
    return total


def written(draft: Draft) -> tuple[dict[str, Any], dict[str, str]]:
    """Return what the index says of a problem, and its files by name."""
    problem = draft.problem()
    scene = json.dumps(to_dict(problem.scene), indent=1) + "\n"
    files = {
        "scene.toml": f"# {problem.title}; assembly: {problem.assembly}\n{to_toml(problem.scene)}",
        "scene.json": scene,
        "model.xml": to_mjcf(problem.scene),
        "exudyn_model.py": to_exudyn(problem.scene, problem.title),
        "certified.json": json.dumps(_certified(problem, scene), indent=1) + "\n",
    }
    attainable = {level: round(digits, 1) for level, digits in CertifiedTruth(problem.scene).attainable.items()}
    about = {"name": problem.name, "family": problem.family, "dimension": problem.scene.mechanism.kind.name}
    about |= {"title": problem.title, "assembly": problem.assembly}
    return {**about, "attainable": attainable}, files


def _certified(problem: Problem, scene: str) -> dict[str, Any]:
    mechanism = problem.scene.mechanism
    units, size = UNITS[mechanism.kind.name], mechanism.unit().size
    scales = [size if unit == "length" else 1.0 for unit in units] * len(mechanism.bodies)
    return {
        "name": problem.name,
        "title": problem.title,
        "assembly": problem.assembly,
        "scene": sha256(scene.encode()).hexdigest(),
        "size": size,
        "units": units,
        "columns": {body.name: len(units) * k for k, body in enumerate(mechanism.bodies)},
        "t": problem.scene.times,
        **dict(zip(("q", "qd", "qdd"), problem.truth, strict=True)),
        "others": [
            {at: [round(x / s, NEAREST) * s + 0.0 for x, s in zip(q, scales, strict=True)] for at, q in others.items()}
            for others in problem.others
        ],
    }
