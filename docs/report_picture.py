"""Make the pictures of docs/report.md: run the demo, and take its report in a headless Chromium."""

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright
from typer.testing import CliRunner

from cartpend_dae.cli import app

HERE = Path(__file__).resolve().parent
VIEWS = {
    "report.png": {"viewport": {"width": 1280, "height": 800}},
    "report-phone.png": {"viewport": {"width": 390, "height": 800}, "device_scale_factor": 1.5, "color_scheme": "dark"},
}


def main():
    program = shutil.which("chromium")
    if program is None:
        sys.exit("There is no `chromium` on this machine; `apt-get install chromium` brings it.")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        out = Path(folder) / "demo"
        assert CliRunner().invoke(app, ["demo", "--out", str(out)]).exit_code == 0
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        for name, view in VIEWS.items():
            page = browser.new_page(**view)
            page.goto((out / "results" / "report.html").as_uri())
            page.screenshot(path=HERE / name)
        browser.close()


if __name__ == "__main__":
    main()
