"""What is made when the book is built: pictures of mechanisms, the keys of every joint, the findings, the gallery."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

from rich.console import Console

from crosscheck.judge.known_gaps import read_findings
from refkin.joints import DRIVER_TYPES, JOINT_TYPES, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES
from refkin.model import Scene
from refkin.output import Drawing, animated, still
from refkin.scenes.files import load
from refkin.scenes.linkages import RSSR, Bennett, Stewart
from refkin.solving.solve import solve

ROOT = Path(__file__).parent.parent
KEYS = {
    "name": "what reports and faults call it; each name once",
    "body_i": 'the first body, or `"ground"`',
    "body_j": 'the second body, or `"ground"`',
    "body": "the body that is driven",
    "relative_to": "the body against which the angle counts",
    "point_i": "a point of body i, in its frame [m]",
    "point_j": "a point of body j, in its frame [m]",
    "point": "a point of the body, in its frame [m]",
    "axis_i": "a direction in the frame of body i; any vector but zero",
    "axis_j": "the same direction in the frame of body j",
    "zero_i": "a direction across the axis in the frame of body i, from which the angle counts",
    "zero_j": "the same in the frame of body j, to which the angle counts",
    "pitch": "shift for each radian [m/rad]",
    "shift": "shift where the angle is 0 [m]",
    "spacing": "of the form `printed`: distance of two points of the axis [m]; by default the size of the mechanism",
    "form": "which rows state it: {} ([theory](theory.md#joints-of-space))",
    "joint": "the name of the joint that is driven",
    "joint_i": "the name of a joint between a wheel and the carrier: revolute, cylindrical or screw, with zeros",
    "joint_j": "the name of the other wheel's joint with the same carrier",
    "angle": "how far body j is turned against body i [rad]",
    "length": "distance of the two points [m], above 0",
    "offset_law": "two laws, x and y [m]: what leads from point i to point j, in the ground frame",
    "radius": "radius of the pinion [m]: positive to the right of the axis, negative to the left",
    "radius_i": "radius of the wheel on body i, or of joint i, where it rolls [m]; only the ratio counts",
    "radius_j": "radius of the other wheel [m]; of opposite sign for an internal gear or a belt",
    "phi0": "angle of the pinion against the rack where it stands at `s0` [rad]",
    "phi0_i": "angle of body i, or of joint i, where counting begins [rad]",
    "phi0_j": "angle of body j, or of joint j, where counting begins [rad]",
    "carrier": "the body on which both centres are at rest, and against which the angles count: the arm of a planet",
    "s0": "where along the rack the pinion's centre is at `phi0` [m]",
    "profile": '`{ kind = "disc", radius }` around point i, or `{ kind = "polar", law }`: distance [m] by angle [rad]',
    "follower": '`"flat"`, `"point"` or `"roller"`',
    "normal_j": "normal of a flat follower's face, in the frame of body j",
    "roller_radius": "radius of a roller [m]",
    "contact_estimate": "about where the profile is touched at the first time [rad]; tried if absent",
    "law": "the value as a function of time: one of the laws below",
    "rate_law": "instead of `law`: the rate as a function of time, integrated exactly",
    "initial": "the value at t = 0, beside `rate_law`",
}
"""What a key means, wherever it stands."""
FEW = 10
"""A scene of so few times stands still in the gallery: it is not shown."""


def make(docs: Path) -> None:
    """Write all of it below `_made`."""
    out = docs / "_made"
    out.mkdir(exist_ok=True)
    for file in sorted((docs / "scenes").glob("*.toml")):
        _write(docs / "_static" / "made" / f"{file.stem}.svg", still(drawn(load(file))))
    _write(out / "joints.md", "\n".join(section(cls, "joint") for cls in JOINT_TYPES))
    _write(out / "drivers.md", "\n".join(section(cls, "driver") for cls in DRIVER_TYPES))
    _write(out / "spatial_joints.md", "\n".join(section(cls, "joint", "spatial-") for cls in SPATIAL_JOINT_TYPES))
    _write(out / "spatial_drivers.md", "\n".join(section(cls, "driver", "spatial-") for cls in SPATIAL_DRIVER_TYPES))
    _write(out / "commands.md", "\n".join(commands()))
    _write(out / "findings.md", "\n".join(findings()))
    _write(out / "gallery.md", "\n".join(gallery(docs)))


def _write(file: Path, text: str) -> None:
    """Write a file, unless it holds the text already: Sphinx reads anew whatever is newer."""
    file.parent.mkdir(parents=True, exist_ok=True)
    if not file.is_file() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")


def drawn(scene: Scene) -> Drawing:
    """Return what there is to see of a scene."""
    asked = replace(scene, bodies_wanted=None, effects=frozenset(), evidence=frozenset())
    return Drawing(asked, solve(asked))


def section(cls: Any, kind: str, prefix: str = "") -> str:
    """Return the section of a joint or driver: what it says, its picture, its keys, a scene."""
    name = cls.__dataclass_fields__["type"].default
    stem = prefix + (name if kind == "joint" else f"{name}-driver")
    rows = "\n".join(key_rows(cls))
    said = " ".join((cls.__doc__ or "").split("\n\n")[0].split())
    return f"""
### `{name}`

{said}

```{{image}} _static/made/{stem}.svg
:class: mechanism
:alt: A mechanism with a {kind} of type {name}
```

| key | is | default |
|---|---|---|
{rows}

The scene of the picture:

```{{literalinclude}} scenes/{stem}.toml
:language: toml
```
"""


def key_rows(cls: Any) -> Iterator[str]:
    """Yield a row of the table for each key of a joint; a key without a meaning in `KEYS` is an error."""
    for key in fields(cls):
        if key.name == "type":
            continue
        default = "needed" if key.default is MISSING else "none" if key.default is None else f"`{_toml(key.default)}`"
        words = " or ".join(f'`"{word}"`' for word in get_args(get_type_hints(cls)[key.name]))
        yield f"| `{key.name}` | {KEYS[key.name].replace('{}', words)} | {default} |"


def _toml(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else str(list(value) if isinstance(value, tuple) else value)


CLASSES = {
    "contract violated": "The engine's documentation promises something else: a fault.",
    "documented limit": "The engine says that it does not promise more, if one knows where to read it.",
    "our misuse": "The engine can do better, and another method of it does: it was asked in a way that loses digits.",
}


def findings() -> Iterator[str]:
    """Yield what engines were seen to do, from the table that a test holds true."""
    known = read_findings()
    for kind, meaning in CLASSES.items():
        yield f"\n## {kind.capitalize()}\n\n{meaning}\n"
        for finding in (f for f in known if f.kind == kind):
            asked = f": {', '.join(finding.cases)}" if finding.cases else ""
            yield f"\n### {finding.engine}, {finding.method}{asked}\n"
            yield " ".join(finding.reason.split()) + "\n"
            yield f"> {' '.join(finding.quote.split())}\n>\n> — {finding.source}\n"
            shown = ", ".join(f"`{path}`" for path in (finding.script, finding.scene) if path)
            yield f"Versions: {finding.since}. Seen on {finding.date}; to see it again: {shown}.\n"


def commands() -> Iterator[str]:
    """Yield what the command line prints of itself, command by command."""
    from crosscheck.cli import COMMANDS, app

    yield "| command | does |\n|---|---|"
    yield from (f"| [`{name}`](#{name.replace(' ', '-')}) | {what} |" for name, (_, what) in COMMANDS.items())
    for name in COMMANDS:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            console = Console(file=printed, width=110, force_terminal=False, color_system=None)
            app([*name.split(), "--help"], console=console, exit_on_error=False, result_action="return_value")
        yield f"\n({name.replace(' ', '-')})=\n\n## {name}\n\n```text\n{printed.getvalue().strip()}\n```"


def gallery(docs: Path) -> Iterator[str]:
    """Yield moving pictures: the examples, and the scenes of this book that move far enough."""
    for name, scene in linkages().items():
        yield from animation(docs, name, scene, f"refkin.scenes.linkages.{name}")
    for file in (*sorted((ROOT / "examples").glob("*.toml")), *sorted((docs / "scenes").glob("*.toml"))):
        scene = load(file)
        if len(scene.times) > FEW:
            yield from animation(docs, file.stem, scene, f"crosscheck animate {file.relative_to(ROOT)}")


def animation(docs: Path, stem: str, scene: Scene, made_by: str) -> Iterator[str]:
    """Yield the place of a moving picture, which is written."""
    _write(docs / "_static" / "made" / f"moving-{stem}.svg", animated(drawn(scene)))
    yield f"\n## {scene.name}\n\n```{{image}} _static/made/moving-{stem}.svg\n:class: mechanism"
    yield f":alt: {scene.name} in motion\n```\n\n`{made_by}`"


def linkages() -> dict[str, Scene]:
    """Return the famous ones of space, each over a turn of its input."""
    rssr = RSSR(crank=1.0, coupler=3.0, rocker=2.0, pivot=(2.5, -0.5, 0.75), axis=(0.25, 1.0, 0.125))
    named: dict[str, Any] = {
        "Bennett's linkage": Bennett(length=1.0, alpha=0.6, beta=1.1),
        "RSSR": rssr,
        "Stewart platform": Stewart.three_three(),
    }
    return {name.split()[0].split("'")[0]: made.scene(samples=61, name=name) for name, made in named.items()}
