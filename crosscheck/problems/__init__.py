"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it.
"""

VERSION = "2"
"""Of the set; whoever changes a problem, an answer or how they are written gives it another."""
SHA256 = "56634fb02f7582bfb1f105cc27eb8dbfbe0b4a65a9db17f9621fce2f29b1a637"
"""The hash of the whole set of that version."""
