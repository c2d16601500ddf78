"""`crosscheck diagnose`: what the poses of a scene are where they are hard, in words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.commands.solve import SCHEMA, numbers
from crosscheck.commands.usage import Json
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.singularity.diagnosis import Diagnosis, PoseKind
from refkin.scenes.files import load
from refkin.solving.diagnose import diagnose
from refkin.solving.solve import solve


def hardest(motion: Motion) -> int | None:
    """Return the number of the first singular pose, or else of that with the smallest sigma; None without a pose."""
    if Status.SINGULAR in motion.status:
        return motion.status.index(Status.SINGULAR)
    reached = np.isfinite(motion.q[0])
    return int(np.argmin(np.where(reached, motion.sigma_min, np.inf))) if reached.any() else None


def lines(motion: Motion, t: float, diagnosis: Diagnosis) -> list[str]:
    """Return a diagnosis as lines to print."""
    text = [
        f"verdict: {motion.verdict.value}",
        f"t = {t:.17g}",
        diagnosis.message,
        f"smallest singular value of the balanced Jacobian: {diagnosis.sigma:.3g}",
    ]
    if diagnosis.rows:
        text.append(f"rows: {', '.join(diagnosis.rows)}")
    if diagnosis.bodies:
        text.append(f"bodies: {', '.join(diagnosis.bodies)}")
    return text + [f"tangent: {np.array2string(tangent, precision=6)}" for tangent in diagnosis.tangents]


def to_json(scene: Scene, motion: Motion, k: int | None, diagnosis: Diagnosis | None) -> dict[str, Any]:
    """Return a diagnosis as plain data; null where there is no pose."""
    header: dict[str, Any] = {"schema": SCHEMA, "scene": scene.name, "verdict": motion.verdict.value}
    if k is None or diagnosis is None:
        return {**header, "message": motion.message, "t": None, "kind": None}
    names, width = [body.name for body in scene.mechanism.bodies], scene.mechanism.kind.width
    return {
        **header,
        "message": diagnosis.message,
        "t": float(motion.t[k]),
        "kind": diagnosis.kind.value,
        "sigma": diagnosis.sigma,
        "rows": list(diagnosis.rows),
        "bodies": list(diagnosis.bodies),
        "other_driver": diagnosis.other_driver or None,
        "tangents": [
            {name: numbers(v[width * k : width * (k + 1)]) for k, name in enumerate(names)}
            for v in map(np.asarray, diagnosis.tangents)
        ],
    }


def print_diagnosis(scene: Path, *, as_json: Json = False) -> int:
    """Say what the hardest pose of a scene is: regular, or by which kind of singularity it is not.

    Exit codes: 0 it is regular, or a structure, or has redundant rows that agree; 1 it is singular, or there is no
    pose; 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    as_json
        Print one JSON object instead of lines.
    """
    read = replace(load(scene), bodies_wanted=None)
    motion = solve(read)
    k = hardest(motion)
    if k is None:
        none = f"{motion.verdict.value}: {motion.message}"
        print(json.dumps(to_json(read, motion, None, None)) if as_json else none)
        return 1
    contacts = [contact.s[k] for contact in motion.contacts.values()]
    answer = diagnose(read, np.append(motion.q[:, k], contacts), float(motion.t[k]))
    text = json.dumps(to_json(read, motion, k, answer)) if as_json else "\n".join(lines(motion, motion.t[k], answer))
    print(text)
    ended = motion.status[k] is Status.OK and answer.kind in (PoseKind.REGULAR, PoseKind.STRUCTURE, PoseKind.REDUNDANT)
    return 0 if ended else 1
