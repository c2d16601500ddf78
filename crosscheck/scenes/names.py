"""Names that engines, judgement and report share, and what a scene calls for by them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from refkin.model import Effect, Scene

QUANTITIES = ("position", "velocity", "acceleration")
"""What is computed of a motion, by order."""
PHYSICAL = ("gravity", "contact", "friction", "joint limits", "passive forces", "actuation", "sensors", "inertia")
"""What a kinematic scene never calls for: every adapter has it switched off or at its least."""
PEERS = ("exudyn", "pinocchio", "mujoco")
"""Who is asked where nobody says whom to ask."""


def order_of(scene: Scene) -> int:
    """Return the highest order that a scene calls for."""
    if Effect.ACCELERATION in scene.effects:
        return 2
    return 1 if Effect.VELOCITY in scene.effects else 0


def called_for(scene: Scene, levels: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return position, velocity and acceleration; None for what was computed on the way, or not at all."""
    q, qd, qdd, *_ = (*levels, None, None)
    return q, qd if Effect.VELOCITY in scene.effects else None, qdd if Effect.ACCELERATION in scene.effects else None
