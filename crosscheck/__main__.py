"""`python -m crosscheck` is `crosscheck`: the command line, in a process of its own."""

import gc
import os


def main() -> None:
    """Run the command line, whose modules are loaded as a process loads them that ends when they have done their work.

    What is loaded stays: looking for what could be freed of it is a tenth of the time of a small command. And pydantic
    need not ask every package that is installed whether it adds something to it.
    """
    gc.set_threshold(10_000)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from crosscheck.cli import main as command_line

    command_line()


if __name__ == "__main__":
    main()
