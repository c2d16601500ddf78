"""How sure we are: what is proved of a pose, beside how it was computed."""

from refkin.proof.assembly.assembly import Assemblies, assemblies

__all__ = ["Assemblies", "assemblies"]
