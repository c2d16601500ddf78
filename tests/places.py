"""Where the files are that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
CORPUS, EXAMPLES = ROOT / "tests" / "corpus", ROOT / "examples"
