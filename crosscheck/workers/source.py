"""The digest of our own source: a version says less, two programs may have the same."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = "source code"
"""What the digest is called beside the versions of engines."""
KINDS = {".py", ".toml", ".j2", ".c", ".h"}
"""Endings of what we wrote, and what runs; not of what a night may write."""


@cache
def digest(root: Path = ROOT) -> str:
    """Return 16 hex digits of the names and the content of all source of refkin and crosscheck.

    Kept as it was when first asked: what runs is what was loaded. Ends of lines do not count, so that a checkout on
    Windows has the same digest.
    """
    files = [file for name in ("refkin", "crosscheck") for file in (root / name).rglob("*") if file.suffix in KINDS]
    whole = hashlib.sha256()
    for name, file in sorted((file.relative_to(root).as_posix(), file) for file in files):
        content = file.read_bytes().replace(b"\r\n", b"\n")
        whole.update(f"{name} {len(content)}\n".encode() + content)
    return whole.hexdigest()[:16]


def files_of(engines: Mapping[str, str]) -> dict[str, str]:
    """Return the digest of each file that an engine is taken from, `file.py:Class`: its version says less."""
    files = {f"file of {name}": Path(spec.rpartition(":")[0]) for name, spec in engines.items()}
    found = {key: path for key, path in files.items() if path.suffix == ".py" and path.is_file()}
    return {key: hashlib.sha256(path.read_bytes()).hexdigest()[:16] for key, path in found.items()}
