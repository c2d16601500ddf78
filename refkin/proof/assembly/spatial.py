"""Assemblies of spatial mechanisms: those that many starts lead to.

Nothing is proved to be all there is. Starts come from a fixed sequence: orientations spread evenly over all turns
(Shoemake, Uniform random rotations, 1992, on Halton's sequence), origins within the mechanism's size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from refkin.joints import initial_contacts
from refkin.proof.assembly.search import PRIMES, SAME, radical_inverse, refined
from refkin.system import System

MOST_STARTS = 120
MOST_POSES = 48
ENOUGH = 40
"""How many starts in a row may lead nowhere new."""


def starts(system: System, t: float, count: int = MOST_STARTS, first: int = 1) -> Iterator[Any]:
    """Yield poses (n,) of bodies that no joint holds, spread evenly."""
    bodies, width = len(system.mechanism.bodies), system.kind.width
    for k in range(first, first + count):
        q = np.zeros(system.n)
        for body in range(bodies):
            at = 1 + k * bodies + body  # a point of the sequence for each body
            u = [radical_inverse(at, base) for base in PRIMES[:6]]
            a, b = math.sqrt(1 - u[0]), math.sqrt(u[0])
            s, c = math.tau * u[1], math.tau * u[2]
            turn = (b * math.cos(c), a * math.sin(s), a * math.cos(s), b * math.sin(c))
            q[width * body : width * (body + 1)] = (*(2 * x - 1 for x in u[3:]), *turn)
        yield initial_contacts(system, q, t)


def assemblies_in_space(system: System, t: float) -> list[Any]:
    """Return the poses (n,) that Newton's method, or least squares, reaches from many starts; of p and -p one."""
    poses: list[Any] = []
    since = 0
    for start in starts(system, t):
        q = refined(system, start, t)
        q = None if q is None else signed(system, q, np.ones(system.n))
        new = q is not None and all(np.max(np.abs(q - other)) > SAME for other in poses)
        since = 0 if new else since + 1
        if new:
            poses.append(q)
        if len(poses) >= MOST_POSES or since >= ENOUGH:
            break
    return poses


def signed(system: System, q: Any, like: Any) -> Any:
    """Return a pose (n,) with the Euler parameters of each body on the side of those in another pose."""
    q = np.array(q)
    for body in system.mechanism.bodies:
        at = system.columns(body.name)
        p = slice(at.start + system.kind.dimension, at.stop)
        if q[p] @ like[p] < 0:
            q[p] = -q[p]
    return q
