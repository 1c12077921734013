"""Entry point of `python -m whiptool.human`, and the names of `papers.human` that notebooks import."""

import sys

from whiptool.commands.papers import human, of_papers


def __getattr__(name: str) -> object:
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(of_papers("human"), name)


def __dir__() -> list[str]:
    return dir(of_papers("human"))


if __name__ == "__main__":
    sys.exit(human())
