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
    silent: Collection[str],
    new: int,
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
    silent : collection of str
        Engines that were loaded and answered no scene at all.
    new, failures, scenes : int
        New disagreements; scenes without a result and other failures of the run; scenes with a record.
    """
    absent = [name for name in required if name in missing]
    if absent:
        return ENGINE_MISSING, "; ".join(f"{name} is required and missing: {missing[name]}" for name in absent)
    if new:
        return NEW_DISAGREEMENTS, f"{new} disagreement{'s' * (new > 1)} that no known gap accounts for"
    if failures:
        return INFRASTRUCTURE, f"{failures} failure{'s' * (failures > 1)} of the run itself; what it checked agrees"
    if not scenes:
        return NOTHING_RAN, "there is no record of any scene"
    mute = [name for name in required if name in silent]
    if mute:
        return ENGINE_MISSING, f"required, loaded, and without an answer to any scene: {', '.join(mute)}"
    return PASS, "every judged answer is within its derived budget, known gaps aside"
