"""The groups of the core: coordinates that can only be found together, in an order in which they can be found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from refkin.errors import RefkinError
from refkin.fast.elimination.tree import Row

SMALL = 3
"""Up to this many coordinates every matching is tried: to import SciPy's graphs takes longer than to compile."""


class NotReducible(RefkinError):
    """The equations have no unique solution by their structure alone: some are redundant, others are missing."""


def blocks_of(matrix: Sequence[Row], core: Sequence[int]) -> tuple[dict[int, int], list[list[int]]]:
    """Return for each core coordinate its row, and the coordinates by strongly connected groups, upstream first.

    Raises
    ------
    NotReducible
        If there is no perfect matching of rows and coordinates.
    """
    place = {c: k for k, c in enumerate(core)}
    pattern = np.zeros((len(matrix), len(core)), np.int8)
    for i, row in enumerate(matrix):
        pattern[i, [place[c] for c in row]] = 1
    row_of = _matching(pattern) if len(matrix) == len(core) else None
    if row_of is None:
        raise NotReducible(f"{len(core)} core coordinates and {len(matrix)} rows that cannot be matched one to one")
    ordered = pattern[row_of]  # the row of each coordinate
    needs = {k: np.flatnonzero(others).tolist() for k, others in enumerate(ordered)}
    matched = {c: int(row_of[k]) for k, c in enumerate(core)}
    return matched, [[core[k] for k in group] for group in _upstream_first(_labels(ordered), needs)]


def _matching(pattern: Any) -> Any:
    """Return for each column a row of its own with an entry there; None if there are no such rows."""
    size = len(pattern)
    if size <= SMALL:
        every = permutations(range(size))
        return next((list(rows) for rows in every if all(pattern[r, c] for c, r in enumerate(rows))), None)
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    matching = maximum_bipartite_matching(csr_array(pattern), perm_type="row")
    return None if (matching < 0).any() else matching


def _labels(ordered: Any) -> list[int]:
    """Return for each coordinate the number of its strongly connected component."""
    size = len(ordered)
    if size <= SMALL:
        reach = np.linalg.matrix_power(ordered.astype(int) + np.eye(size, dtype=int), size) > 0
        return [int(np.argmax(reach[k] & reach[:, k])) for k in range(size)]
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    return connected_components(csr_array(ordered), directed=True, connection="strong")[1].tolist()


def _upstream_first(label: Sequence[int], needs: Mapping[int, Sequence[int]]) -> list[list[int]]:
    """Return the members of each label, the labels in an order in which none needs a later one."""
    members: dict[int, list[int]] = {}
    for k, group in enumerate(label):
        members.setdefault(group, []).append(k)
    upstream = {g: {label[o] for k in ks for o in needs[k]} - {g} for g, ks in members.items()}
    order: list[int] = []
    while len(order) < len(members):
        order += [g for g in members if g not in order and upstream[g] <= set(order)]
    return [members[g] for g in order]
