"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it.
"""

VERSION = "4"
"""Of the set; whoever changes a problem, an answer or how they are written gives it another."""
SHA256 = "101c494a968798c53065a609b71ba54e680e148dcbcf40675c59f46c76865f22"
"""The hash of the whole set of that version."""
