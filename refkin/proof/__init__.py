"""How sure we are: what is proved of a pose, beside how it was computed."""

from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.search import Assemblies

__all__ = ["Assemblies", "assemblies"]
