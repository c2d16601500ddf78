"""`crosscheck engines`, and the names of engines on the command line."""

from __future__ import annotations

from crosscheck.commands.tables import capability_table
from crosscheck.commands.usage import console
from crosscheck.engines import PEERS, available
from crosscheck.engines import load as load_engine
from crosscheck.errors import PASS, UsageError
from crosscheck.night.plan import ALWAYS, SAMPLED
from crosscheck.workers.installed import find_engines

ENGINES = ",".join(PEERS)


def print_engines() -> int:
    """Print what each engine can do: joint x engine x level, and why not where it refuses."""
    installed, missing = find_engines(tuple(sorted(available())))
    out = console(160)
    out.print(capability_table(load_engine(spec) for spec, _ in installed.values()))
    for name, (_, version) in installed.items():
        out.print(f"{name} {version}")
    for reason in missing.values():
        out.print(reason)
    return PASS


def names(text: str, always: tuple[str, ...] = (ALWAYS, *SAMPLED)) -> tuple[str, ...]:
    """Return the names in a list separated by commas; an engine nobody has heard of is a usage error."""
    named = [name.strip() for name in text.split(",") if name.strip()]
    known = available()
    for name in named:
        if name not in known and ":" not in name:
            raise UsageError(f"no engine is called {name!r}; there are: {', '.join(sorted(known))}, or file.py:Class")
    return tuple(dict.fromkeys((*always, *named)))
