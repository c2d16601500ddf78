"""Names that engines, judgement and report share."""

QUANTITIES = ("position", "velocity", "acceleration")
"""What is computed of a motion, by order."""
PHYSICAL = ("gravity", "contact", "friction", "joint limits", "passive forces", "actuation", "sensors", "inertia")
"""What a kinematic scene never calls for: every adapter has it switched off or at its least."""
PEERS = ("exudyn", "pinocchio", "mujoco")
"""Who is asked where nobody says whom to ask."""
