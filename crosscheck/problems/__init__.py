"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, `certified` proves the
answers, `mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which
needs nothing but Python, beside it.
"""

VERSION = "1"
"""Of the set; whoever changes a problem or an answer gives it another."""
SHA256 = "13090fd760b919327e63a267d00a13774cd909c8c3d5d0f00308fcbb6d4ef33b"
"""The hash of the whole set of that version."""
