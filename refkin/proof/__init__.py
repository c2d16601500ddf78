"""How sure we are: what is proved of a pose, beside how it was computed."""
