"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it.
"""

VERSION = "3"
"""Of the set; whoever changes a problem, an answer or how they are written gives it another."""
SHA256 = "1b028d6d707867f33d2354a6146fb546f8d7b723d93deac31d44797fe98bcec5"
"""The hash of the whole set of that version."""
