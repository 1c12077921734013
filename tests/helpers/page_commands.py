"""The commands of README and documentation, as they are typed there, and what is run of them."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

from command_line import called, whiptool
from processes import HANG
from repository import ROOT

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md")), *sorted((DOCS / "how-to").glob("*.md"))]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"(?<!\})`([^`\n]+)`")  # code of a line; not a role such as {doc}
INSTALL = re.compile(r"pip install '(?:whiptool|\.)\[([\w,]+)\]'")
OURS = "python -m whiptool."
ELSEWHERE = ("make ", "git ", ". ", "cd ", "pip ", "ray ", "python benchmarks/")  # installs, or tested where they are
# servos, robots and clusters that no test has
NEEDS_HARDWARE = ("/dev/ttyUSB0", "192.168.0.10", "ur://127.0.0.2", "172.16.0.2", "--cluster auto")
SERVES = ("emulator", "whiptool.studio")  # until it is stopped
# What takes more than some ten seconds: `make docs-commands` runs it to its end, other tests only start it
LONG = re.compile(
    r"whiptool\.(train|compare|reproduce|human|adapt|map|rig|robot|identify)\b"
    r"|--model (nah2023 --controller|ur5e|panda|fr3|three|run/identified)"
    r"|--pareto|--minimise|--resume|--method cmaes|--cone|--control-period"
)
SHORT = re.compile(
    r"map strike ur5e |adapt --target 1.15 0.05 --camera tip --preset table4$"
    r"|adapt --model ur5e --port robot|adapt --resume run$|optimize --resume|--export "
)


def name_of(page: Path) -> str:
    """Return a page's name in the documentation, such as `tutorial.md` and `how-to/identify.md`."""
    return str(page.relative_to(DOCS)) if page.is_relative_to(DOCS) else page.name


def needs_of(page: Path) -> set[str] | None:
    """Return the extras that a page names at its top, in the paragraph that begins with `*Needs:*`, or None."""
    paragraphs = page.read_text(encoding="utf-8").split("\n\n")[:3]
    needs = [text for text in paragraphs if text.startswith("*Needs:*")]
    return {extra for found in INSTALL.findall(needs[0]) for extra in found.split(",")} if needs else None


@dataclass(frozen=True)
class Command:
    """A command of a page.

    Args:
        page: Where it stands.
        line: As it is typed, lines that go on joined, without its comment.
    """

    page: Path
    line: str

    def __str__(self) -> str:
        return f"{name_of(self.page)}: {self.line}"

    @property
    def ours(self) -> bool:
        """Whether whiptool is what it calls."""
        return self.line.startswith(OURS)

    @property
    def elsewhere(self) -> bool:
        """Whether it installs something, or is tested elsewhere."""
        return self.line.startswith(ELSEWHERE)

    @property
    def serves(self) -> bool:
        """Whether it runs until it is stopped."""
        return any(name in self.line for name in SERVES) and "--mcap" not in self.line

    @property
    def words(self) -> list[str]:
        """What is behind `python -m`, as a shell splits it: `["whiptool.rig", "strike", "--json"]`."""
        return shlex.split(self.line)[2:]

    @property
    def long(self) -> bool:
        """Whether it takes more than some ten seconds."""
        return bool(LONG.search(self.line)) and not SHORT.search(self.line)

    def run(self, folder: Path) -> subprocess.CompletedProcess:
        """Run it in a folder as a shell would, in this process where it can be."""
        if not self.ours:
            shell = ["sh", "-c", self.line]
            return subprocess.run(shell, cwd=folder, capture_output=True, text=True, timeout=HANG, check=False)
        name, *words = [name for word in self.words for name in _expanded(word, folder)]
        if name == "whiptool.doctor":  # it quietens whoever calls it
            return whiptool("doctor", *words, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)})
        try:
            return called(name.removeprefix("whiptool.").removeprefix("rig."), *words, cwd=folder)
        except SystemExit as end:  # of `--help`
            return subprocess.CompletedProcess(self.words, int(end.code or 0), "", "")


def _expanded(word: str, folder: Path) -> list[str]:
    """Return what a shell makes of a word: the names of files for `*.csv`."""
    return sorted(path.name for path in folder.glob(word)) or [word] if "*" in word else [word]


def commands_of(page: Path) -> list[Command]:
    """Return a page's commands in their order: those of its blocks, and those in code of its lines."""
    found = []
    for language, text in parts_of(page):
        if language in ("sh", "span"):
            found += [Command(page, line) for line in lines_of(text) if not line.startswith(ELSEWHERE)]
    return [command for command in dict.fromkeys(found) if command.ours and "NAME" not in command.line]


def parts_of(page: Path) -> list[tuple[str, str]]:
    """Return a page's blocks of code, by language, and the code in its lines as `span`, in their order."""
    text = page.read_text(encoding="utf-8")
    blocks = [(match.start(), match[1], match[2]) for match in FENCE.finditer(text)]
    prose = FENCE.sub(lambda match: " " * len(match[0]), text)
    spans = [(match.start(), "span", match[1]) for match in SPAN.finditer(prose)]
    return [(language, body) for _, language, body in sorted(blocks + spans)]


def lines_of(text: str) -> list[str]:
    """Return the lines of a shell, without their comments."""
    joined = re.sub(r"\\\n\s*", "", text)
    return [line for line in (re.sub(r"(^|\s)\s*#.*", "", x).strip() for x in joined.splitlines()) if line]
