"""Checks of the project by itself, each a named claim that can fail; tests and the mutants command run the same ones.

`claims` says what a check is; the other modules hold the checks, by what they check.
"""

from crosscheck.selfchecks import (
    contacts,
    derivatives,
    driven_linkages,
    evidence,
    freedoms,
    joints,
    laws,
    linkages,
    moving_places,
    redundant,
    solver,
    solving,
    vector_loops,
)
from crosscheck.selfchecks.claims import CHECKS, Check, CheckFailed

MODULES = (
    contacts,
    derivatives,
    driven_linkages,
    evidence,
    freedoms,
    joints,
    laws,
    linkages,
    moving_places,
    redundant,
    solver,
    solving,
    vector_loops,
)
"""Those that hold checks."""

__all__ = ["CHECKS", "MODULES", "Check", "CheckFailed"]
