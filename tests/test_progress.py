"""Progress bars leave nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import HANG

from whiptool.progress import Progress

SCRIPT = """
import sys, time
from pathlib import Path
from whiptool.commands import cli

def unit(path):
    from whiptool.progress import Progress  # named here, as a worker has to import it
    with Progress(total=1, disable=False):
        Path(path).touch()
        time.sleep(3600)

def command():
    from whiptool.comparison.units import work_on
    for _ in work_on({name: name for name in sys.argv[1:]}, unit, workers=2):
        pass
    return 0

if __name__ == "__main__":
    sys.exit(cli.run(command))
"""


def test_a_bar_has_a_lock_of_its_own_process():
    with Progress(total=1, file=open(os.devnull, "w")):  # noqa: PTH123
        assert type(Progress.get_lock()).__module__ == "_thread"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_leaks_nothing_of_its_workers(number: signal.Signals, tmp_path: Path) -> None:
    script, drawn = tmp_path / "command.py", [tmp_path / "one", tmp_path / "two"]
    script.write_text(SCRIPT)
    words = [sys.executable, str(script), *map(str, drawn)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not all(path.exists() for path in drawn):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(number)
    said = process.communicate(timeout=HANG)[1]
    assert process.returncode == 130
    assert "interrupted" in said
    assert "leaked" not in said
