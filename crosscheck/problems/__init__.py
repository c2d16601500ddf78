"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it.
"""

VERSION = "1"
"""Of the set; whoever changes a problem or an answer gives it another."""
SHA256 = "15bf2b67fa2f01c4df2017e62c01dead60aafcfcb9ad9dc8e0289a92812c540d"
"""The hash of the whole set of that version."""
