"""How a night ended: computed from what was found, the worst first, never assumed."""

from __future__ import annotations

from collections.abc import Collection, Mapping

PASS = "pass"
NEW_DISAGREEMENTS = "new disagreements"
INFRASTRUCTURE = "infrastructure"
ENGINE_MISSING = "engine missing"
NOTHING_RAN = "nothing ran"


def verdict(
    *,
    required: Collection[str],
    missing: Mapping[str, str],
    answering: Collection[str],
    new: Mapping[str, int],
    failures: int,
    scenes: int,
) -> tuple[str, str]:
    """Return the verdict and the sentence that gives its reason.

    Parameters
    ----------
    required : collection of str
        Engines without which the night is worth nothing.
    missing : mapping
        Engines that could not be loaded -> why.
    answering : collection of str
        Engines that answered at least one scene.
    new : mapping
        New disagreements by engine.
    failures, scenes : int
        Scenes without a result and other failures of the run; scenes with a record.
    """
    absent = [name for name in required if name in missing]
    if absent:
        return ENGINE_MISSING, "; ".join(f"{name} is required and missing: {missing[name]}" for name in absent)
    if new:
        by_engine = ", ".join(
            f"{engine} {count}" for engine, count in sorted(new.items(), key=lambda item: (-item[1], item[0]))
        )
        return NEW_DISAGREEMENTS, f"No known gap accounts for them. By engine: {by_engine}"
    if failures:
        return (
            INFRASTRUCTURE,
            f"{failures} failure{'s' * (failures > 1)} of the run itself; nothing new in what it checked",
        )
    if not scenes:
        return NOTHING_RAN, "There is no record of any scene"
    mute = [name for name in required if name not in answering]
    if mute:
        return ENGINE_MISSING, f"Required, and without an answer to any scene: {', '.join(mute)}"
    without = f"; not compared, because missing: {', '.join(missing)}" if missing else ""
    return PASS, f"Every judged answer is within its derived budget, known gaps aside{without}"
