"""Families of four-bars, their closed form as rows, and rows for other joints; not a test itself."""

from __future__ import annotations

import numpy as np

from .scenes import ROCKER, bare


def grashof(count, margin, seed=0):
    """Lengths (4, count) of ground, crank, coupler, rocker, of which the crank turns fully, drawn uniformly."""
    draw = np.random.default_rng(seed)
    result = np.empty((4, 0))
    while result.shape[1] < count:
        lengths = draw.uniform(0.2, 1.0, (4, 4 * count))
        in_order = np.sort(lengths, axis=0)
        slack = in_order[1] + in_order[2] - in_order[0] - in_order[3]
        turns = (in_order[0] == lengths[1]) | (in_order[0] == lengths[0])
        result = np.concatenate([result, lengths[:, turns & (slack > margin * in_order[3])]], axis=1)
    return result[:, :count]


def closed_form(lengths, phi, sign=1):
    """(A, B, phi of coupler, phi of rocker) at crank angles phi, (M, T); complex points, crank pivot at 0."""
    ground, crank, coupler, rocker = (x[:, None] for x in lengths)
    a = crank * np.exp(1j * phi)
    gap = ground - a
    d = np.abs(gap)
    along = (coupler**2 - rocker**2 + d**2) / (2 * d)
    across = np.sqrt(np.maximum(coupler**2 - along**2, 0.0))
    b = a + (along + 1j * sign * across) * gap / d
    return a, b, np.angle(b - a), np.angle(b - ground)


def geometry(lengths):
    """The points of the joints along their links, whose middles are the bodies' own origins."""
    ground, *links = lengths
    crank, coupler, rocker = (x / 2 for x in links)
    ends = {"A0": (None, -crank), "A": (crank, -coupler), "B": (coupler, rocker), "B0": (ground, -rocker)}
    return {
        name: {key: (x, 0.0) for key, x in zip(("point_i", "point_j"), pair, strict=True) if x is not None}
        for name, pair in ends.items()
    }


def estimates(lengths, sign=1, decimals=3):
    """The first pose at crank angle 0, rounded; to no decimals as it is."""
    ground, crank, _, _ = lengths
    a, b, coupler, rocker = (x[:, 0] for x in closed_form(lengths, np.zeros((1, 1)), sign))
    fields = {
        "crank": (crank / 2, 0.0 * crank, 0.0 * crank),
        "coupler": (((a + b) / 2).real, ((a + b) / 2).imag, coupler),
        "rocker": (((ground + b) / 2).real, ((ground + b) / 2).imag, rocker),
    }
    return {body: np.round(rows, decimals) if decimals else np.array(rows) for body, rows in fields.items()}


def scene(samples=72, **changes):
    return bare(ROCKER.scene(speed=1.0, turns=1, samples=samples), **changes)


def errors(many, lengths, sign=1):
    """Largest errors (M, T) of coupler and rocker: their angles, modulo turns, and the points A and B."""
    _, b, coupler, rocker = closed_form(lengths, np.array(many.t)[None, :], sign)
    angles = (
        np.abs(np.exp(1j * many.q[5]) - np.exp(1j * coupler)),
        np.abs(np.exp(1j * many.q[8]) - np.exp(1j * rocker)),
    )
    tip = many.q[3] + 1j * many.q[4] + 0.5 * lengths[2][:, None] * np.exp(1j * many.q[5])
    return np.maximum.reduce([*angles, np.abs(tip - b)])
