"""The commands of `crosscheck ...`, a module each; `crosscheck.cli` puts them together and says how they end."""
