"""One run of `cartpend demo`, made when first asked for and shared by the tests that look at its results."""

import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

from typer.testing import CliRunner

from cartpend_dae import cli, fleet
from cartpend_dae.discover import Discovery
from cartpend_dae.session import Opened


@dataclass(frozen=True)
class DemoRun:
    """What the command printed and wrote (logs, study and model in `folder`), and the objects behind it."""

    folder: Path
    printed: Any
    opened: Opened
    discovery: Discovery

    @property
    def results(self) -> Path:
        return self.folder / "results"

    def copy_inputs(self, to: Path) -> Path:
        """Copy study, model and logs to a folder; return the study."""
        to.mkdir(parents=True, exist_ok=True)
        for path in self.folder.iterdir():
            if path.is_file():
                shutil.copy(path, to)
        return to / "rota_damp.toml"


@cache
def demo_run() -> DemoRun:
    # kept until the interpreter ends, as the object is
    keeper = tempfile.TemporaryDirectory(prefix="cartpend-demo-")
    folder = Path(keeper.name) / "demo"
    seen = []
    write = fleet.write_discovery

    def spy(out, opened, discovery, seconds, *, jobs):
        seen.append((opened, discovery))
        return write(out, opened, discovery, seconds, jobs=jobs)

    with patch.object(fleet, "write_discovery", spy):
        printed = CliRunner().invoke(cli.app, ["demo", "--out", str(folder)])
    assert printed.exit_code == 0, printed.output
    run = DemoRun(folder, printed, *seen[0])
    object.__setattr__(run, "keeper", keeper)
    return run
