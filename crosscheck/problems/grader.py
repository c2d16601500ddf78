"""Grade answers to this problem set: correct digits, as NIST counts them for its StRD (log relative error, LRE).

    python grade.py ANSWERS.json [FOLDER OF THE SET]

ANSWERS.json holds {"problems": {NAME: {"bodies": {BODY: {"q": [[x, y, phi], ...], "qd": [...], "qdd": [...]}}}}}, one
row per time: what `crosscheck solve --json` prints of each. A number may be a string of more digits than a float has.

The score of a level is -log10(|x - c| / |c|) in the maximum norm over all bodies, c the certified values, at the time
where it is least; from 0 to 30. Lengths count in sizes of the mechanism, angles up to whole turns. |c| is 1 for poses,
for rates the largest component at that time, for accelerations the square of the largest velocity if that is more. In
space rows are [x, y, z, e0, e1, e2, e3], with Euler parameters e of either sign, and their rates. Answers of another
assembly are refused, and said by name.
"""

import json
import sys
from collections.abc import Iterator
from decimal import Context, Decimal, setcontext
from hashlib import sha256
from pathlib import Path
from typing import Any

TURN, MOST = Decimal("6.2831853071795864769252867665590057683943387987502116"), Decimal(30)
FAR = 400
"""Powers of ten beyond which a number is as good as none."""
LEVELS = {"q": "position", "qd": "velocity", "qdd": "acceleration"}


def side(given: Any, right: Any) -> int:
    """Return which of p and -p, one pose of a body of space, was given; of the plane 1."""
    pairs = zip(given[3:], right[3:], strict=True) if None not in given else ()
    numbers = [(Decimal(str(x)), Decimal(c)) for x, c in pairs]
    return -1 if sum(x * c for x, c in numbers if x.is_finite() and x.adjusted() <= FAR) < 0 else 1


def _distance(given: Any, right: Any, truth: Any, level: str, k: int) -> Decimal:
    """Return the largest difference of one time, in sizes and rad; infinite if a number is missing."""
    largest, units = Decimal(0), truth["units"]
    for body, place in truth["columns"].items():
        own = slice(place, place + len(units))
        sign = side(given[body]["q"][k], (right if level == "q" else truth["q"][k])[own])
        for x, c, unit in zip(given[body][level][k], right[own], units, strict=True):
            value = Decimal("nan" if x is None else str(x))
            if not value.is_finite() or value.adjusted() > FAR:
                return Decimal("inf")
            off = value * (sign if unit == "Euler parameter" else 1) - Decimal(c)
            if unit == "angle" and level == "q":
                off -= (off / TURN).to_integral_value() * TURN
            largest = max(largest, abs(off) / (Decimal(truth["size"]) if unit == "length" else 1))
    return largest


def _scale(truth: Any, level: str, k: int) -> Decimal:
    """Return |c| of one time."""
    if level == "q":
        return Decimal(1)
    sizes = [Decimal(truth["size"]) if unit == "length" else 1 for unit in truth["units"]] * len(truth["columns"])
    velocity, rate = (
        max(abs(Decimal(c)) / s for c, s in zip(truth[at][k], sizes, strict=True)) for at in ("qd", level)
    )
    return max(rate, velocity ** (1 if level == "qd" else 2)) or Decimal(1)


def _digits(given: Any, truth: Any, level: str) -> float:
    """Return the score of one level."""
    scores = []
    for k, right in enumerate(truth[level]):
        relative = _distance(given, right, truth, level, k) / _scale(truth, level, k)
        scores.append(-relative.log10() if relative else MOST)
    return float(min(max(min(scores), Decimal(0)), MOST))


def table(value: Any, name: str) -> dict[str, Any]:
    """Return a value that is to be a JSON object; raise ValueError if it is none."""
    if not isinstance(value, dict):
        raise ValueError(f"{name}: {json.dumps(value)[:60]}; expected an object")
    return value


def is_row(row: Any, truth: Any) -> bool:
    """Return whether it is a list of as many numbers, strings of numbers, or nulls as a body has coordinates."""
    try:
        return isinstance(row, list) and len([Decimal("0" if x is None else str(x)) for x in row]) == len(
            truth["units"]
        )
    except ArithmeticError:  # a string that is no number
        return False


def grade(given: Any, truth: Any) -> dict[str, Any]:
    """Return the scores of an answer to one problem, or why it is refused."""
    for body in truth["columns"]:
        for level, rows in {"q": [], **table(given.get(body, {}), body)}.items():
            fits = isinstance(rows, list) and [is_row(row, truth) for row in rows] == [True] * len(truth["t"])
            if level in LEVELS and not fits:
                return {
                    "refused": f"{level} of {body}: {len(truth['t'])} rows of {len(truth['units'])} numbers expected"
                }
    for k, others in enumerate(truth["others"]):
        own = _distance(given, truth["q"][k], truth, "q", k)
        for name, pose in others.items():
            if _distance(given, pose, truth, "q", k) < own:
                return {"refused": f"assembly '{name}' at t = {truth['t'][k]}, '{truth['assembly']}' is asked for"}
    answered = [level for level in LEVELS if all(given[body].get(level) for body in truth["columns"])]
    return {LEVELS[level]: _digits(given, truth, level) for level in answered}


def grade_all(answers: Any, folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and grade of each problem that is answered; raise ValueError where the request makes no sense."""
    setcontext(Context(prec=60))
    index = json.loads((folder / "problems.json").read_text(encoding="utf-8"))
    texts = {p["name"]: (folder / p["name"] / "certified.json").read_bytes() for p in index["problems"]}
    if sha256(b"".join(sha256(text).digest() for text in texts.values())).hexdigest() != index["sha256"]:
        raise ValueError(f"{folder}: the certified answers are not those of this set")
    problems = table(table(answers, "the answers").get("problems", "missing"), "problems")
    if unknown := set(problems) - set(texts):
        raise ValueError(f"no such problems: {', '.join(sorted(unknown))}")
    for name in sorted(problems, key=list(texts).index):
        yield name, grade(table(table(problems[name], name).get("bodies"), f"{name}.bodies"), json.loads(texts[name]))


if __name__ == "__main__":
    refused = 0
    here = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent
    try:
        given = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"), parse_float=str)
        graded = list(grade_all(given, here))
    except (IndexError, KeyError, OSError, RecursionError, ValueError) as error:
        sys.exit(f"usage: grade.py ANSWERS.json [FOLDER]: {type(error).__name__}: {error}")
    for name, scores in graded:
        refused += "refused" in scores
        shown = scores.get("refused") or "  ".join(f"{level} {score:.1f}" for level, score in scores.items())
        print(f"{name}: {'REFUSED, ' * ('refused' in scores)}{shown}")
    sys.exit(refused > 0)
