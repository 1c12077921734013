"""Entry point of `python -m whiptool.reproduce`, and modules of `papers.lemon2024` for notebooks."""

import sys

from whiptool.commands.papers import of_papers, reproduce


def __getattr__(name: str) -> object:
    if name.startswith("__"):
        raise AttributeError(name)
    return of_papers(f"lemon2024.{name}")


if __name__ == "__main__":
    sys.exit(reproduce())
