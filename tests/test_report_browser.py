"""The report in a real browser: it loads nothing and complains of nothing, by hand, keyboard, phone and on paper."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from demo_run import demo_run

from cartpend_dae.report.page import write_page

pytestmark = pytest.mark.xdist_group("report")

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


def without_browser(sentence: str) -> None:
    if os.environ.get("CARTPEND_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{sentence} CARTPEND_REQUIRE_BROWSER=1 makes this a failure.", pytrace=False)
    pytest.skip(sentence)


@pytest.fixture(scope="module")
def browser():
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        without_browser("There is no playwright; `pip install -e .[dev]` brings it.")
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next((found for name in names if (found := shutil.which(name))), None)
    if program is None:
        without_browser("There is no Chromium on this machine; `apt-get install chromium` brings it.")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield running
        running.close()


@contextmanager
def opened(browser, path: Path, *, size=DESKTOP, **options) -> Iterator:
    """Open a page, and assert at the end that it asked for nothing and complained of nothing."""
    context = browser.new_context(viewport=size, **options)
    page = context.new_page()
    asked, complaints = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(path.as_uri())
    yield page
    context.close()
    assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
    assert complaints == []


@pytest.fixture(scope="module")
def report() -> Path:
    return demo_run().results / "report.html"


@pytest.fixture(scope="module")
def long_report(tmp_path_factory) -> Path:
    """The demo's result with four runs of 15,000 samples."""
    folder = tmp_path_factory.mktemp("long")
    result = json.loads((demo_run().results / "result.json").read_text("utf-8"))
    runs = [f"run{k}" for k in range(4)]
    for moment in ("baseline", "final"):
        result[moment]["experiments"] = dict.fromkeys(runs, result[moment]["experiments"]["release3"])
    result["files"]["runs"] = {run: f"{run}.csv" for run in runs}
    rng = np.random.default_rng(1)
    time = 0.001 * np.arange(15_000)
    for k, run in enumerate(runs):
        phi = np.cos(3 * time + k)
        before, after = 0.1 * np.sin(2 * time), 0.001 * rng.standard_normal(time.size)
        columns = {"measured": phi, "before": phi - before, "residual_before": before}
        columns |= {"after": phi - after, "residual_after": after}
        table = pd.DataFrame({"time": time} | {f"bearing.phi.{name}": values for name, values in columns.items()})
        table.loc[5000:5100, ["bearing.phi.measured", "bearing.phi.residual_after"]] = np.nan
        table.to_csv(folder / f"{run}.csv", index=False)
    (folder / "result.json").write_text(json.dumps(result), "utf-8")
    return write_page(folder)


def view_of(page) -> tuple[float, float]:
    return tuple(float(page.get_attribute("#charts", name)) for name in ("data-from", "data-to"))


def until(page, is_so) -> None:
    """Wait until something is so; playwright's own way needs `eval`, which the page forbids."""
    for _ in range(50):
        if is_so():
            return
        page.wait_for_timeout(100)
    pytest.fail("It did not come about within 5 s.")


def violations(page) -> list[str]:
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {node['html']} {node['failureSummary']}" for v in found for node in v["nodes"]]


def test_the_verdict_stands_on_the_first_screen(browser, report):
    with opened(browser, report) as page:
        assert page.inner_text("h1") == "RotaDamp lacked Coulomb friction at bearing."
        for part in ("h1", ".change", ".picture.beside .marked", ".trust dl", ".chips"):
            box = page.locator(part).first.bounding_box()
            assert box is not None and box["y"] < DESKTOP["height"]
        tile = page.inner_text(".tile")
        assert "release3" in tile and "2.17" in tile and "0.0602" in tile
        marked = page.locator(".picture.beside .marked")
        assert marked.locator(".name").text_content() == "bearing"
        assert "Coulomb friction" in marked.text_content()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_axe_finds_nothing(browser, report, scheme, size):
    with opened(browser, report, size=size, color_scheme=scheme, reduced_motion="reduce") as page:
        page.check("#all-candidates")
        for details in page.locator("details").all():
            details.locator("summary").click()
        assert violations(page) == []


def test_a_phone_shows_it_without_moving_sideways(browser, report):
    with opened(browser, report, size=PHONE, has_touch=True) as page:
        width = page.evaluate("document.documentElement.scrollWidth")
        assert width <= PHONE["width"]
        assert page.locator(".picture.alone").is_visible()
        assert not page.locator(".picture.beside").is_visible()
        # fingers need room
        for box in (button.bounding_box() for button in page.locator(".zoom button").all()):
            assert box["height"] >= 32 and box["width"] >= 32


def test_a_phone_writes_charts_large_enough_to_read(browser, report):
    """At least 10 px: drawings shrink with the window, their text must not."""
    with opened(browser, report, size=PHONE) as page:
        charts = page.locator(".horizons .chart")
        size = "c => c.getScreenCTM().a * parseFloat(getComputedStyle(c.querySelector('text')).fontSize)"
        heights = [chart.evaluate(size) for chart in charts.all()]
        assert heights and min(heights) >= 10
        table = page.locator("#ledger table")
        assert table.evaluate("table => table.scrollWidth <= table.parentElement.clientWidth")


def test_four_runs_of_15000_samples_are_ready_within_two_seconds(browser, long_report):
    with opened(browser, long_report) as page:
        assert page.evaluate("window.reportReady") < 2000
        # one look closer redraws all three charts from the full data
        spent = page.evaluate(
            """async () => {
                const begin = performance.now();
                document.querySelector("[data-view=in]").click();
                await new Promise(requestAnimationFrame);
                return performance.now() - begin;
            }"""
        )
        assert spent < 500
        assert view_of(page) == pytest.approx((3.74975, 11.24925))


def test_a_run_is_looked_at_by_keyboard_alone(browser, report):
    with opened(browser, report) as page:
        chosen = "[role=tab][aria-selected=true]"
        assert page.inner_text(chosen).startswith("release3")
        page.focus(chosen)
        page.keyboard.press("ArrowRight")  # past the last to the first
        assert page.inner_text(chosen).startswith("release1")
        assert page.evaluate("document.activeElement.getAttribute('aria-selected')") == "true"
        whole = view_of(page)
        page.focus("#panel")
        page.keyboard.press("+")
        begin, end = view_of(page)
        assert end - begin == pytest.approx((whole[1] - whole[0]) / 2)
        page.keyboard.press("ArrowRight")
        assert view_of(page)[0] == pytest.approx(begin + (end - begin) / 4)
        page.keyboard.press("0")
        assert view_of(page) == whole


def test_a_drag_looks_closer_and_a_double_click_shows_all(browser, report):
    with opened(browser, report) as page:
        whole = view_of(page)
        area = page.locator(".u-over").first
        area.scroll_into_view_if_needed()
        box = area.bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=5)
        page.mouse.up()
        begin, end = view_of(page)
        span = whole[1] - whole[0]
        assert (begin, end) == pytest.approx((whole[0] + 0.25 * span, whole[0] + 0.5 * span), abs=0.01 * span)
        page.mouse.dblclick(box["x"] + 0.6 * box["width"], box["y"] + 60)
        assert view_of(page) == whole


def test_the_wheel_scrolls_the_page_and_with_control_the_curve(browser, report):
    with opened(browser, report) as page:
        page.locator(".u-over").first.scroll_into_view_if_needed()
        box = page.locator(".u-over").first.bounding_box()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60)
        whole = view_of(page)
        page.keyboard.down("Control")
        page.mouse.wheel(0, -200)
        until(page, lambda: view_of(page)[0] > whole[0])
        page.keyboard.up("Control")
        begin, end = view_of(page)
        assert (begin + end) / 2 == pytest.approx((whole[0] + whole[1]) / 2, abs=0.02)
        page.mouse.wheel(100, 0)
        until(page, lambda: view_of(page)[0] > begin)
        assert view_of(page)[1] - view_of(page)[0] == pytest.approx(end - begin)
        moved, scrolled = view_of(page), page.evaluate("scrollY")
        page.mouse.wheel(0, 150)
        until(page, lambda: page.evaluate("scrollY") > scrolled)
        assert view_of(page) == moved


def test_the_pointer_reads_all_curves_at_one_time(browser, report):
    table = pd.read_csv(report.parent / "release3.csv")
    with opened(browser, report) as page:
        area = page.locator(".u-over").first
        area.scroll_into_view_if_needed()
        area.hover(position={"x": 0, "y": 50})
        text = page.locator(".chart-title .value").first.inner_text()
        shown = np.degrees([table[f"bearing.phi.{name}"][0] for name in ("measured", "before", "after")])
        for value in shown:
            assert f"{value:.4g}" in text


def test_curves_are_switched_off_and_candidates_shown(browser, report):
    with opened(browser, report) as page:
        box = page.get_by_label("model before")
        box.uncheck()
        assert not box.is_checked()
        rows = page.locator("#candidate-table tbody tr")
        visible = sum(row.is_visible() for row in rows.all())
        page.check("#all-candidates")
        assert visible < sum(row.is_visible() for row in rows.all()) == rows.count()


def test_the_colours_follow_the_button(browser, report):
    with opened(browser, report, color_scheme="light") as page:
        paper = "getComputedStyle(document.body).backgroundColor"
        light = page.evaluate(paper)
        page.click("#theme")
        dark = page.evaluate(paper)
        assert dark != light and page.inner_text("#theme") == "Dark"
        page.click("#theme")
        assert page.evaluate(paper) == light


def test_paper_has_the_curves_of_all_runs(browser, report):
    with opened(browser, report, color_scheme="dark") as page:
        page.emulate_media(media="print")
        assert not page.locator("#viewer").is_visible()
        assert page.locator(".run .chart").count() == 9  # measured and two residuals of three runs
        assert page.locator(".run .chart").first.is_visible()
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        assert page.evaluate("getComputedStyle(document.querySelector('.missing')).breakInside") == "avoid"
        assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")


def test_without_scripts_the_report_is_read_all_the_same(browser, report):
    with opened(browser, report, java_script_enabled=False) as page:
        assert page.locator(".run .chart").first.is_visible()
        assert not page.locator("#viewer").is_visible()
        assert page.locator("#candidate-table tbody tr").last.is_visible()


def test_a_fit_is_drawn_with_its_band_where_that_is_known(browser, tmp_path):
    """The band of 95 % is not known at samples that were not simulated; the curves are drawn all the same."""
    source = demo_run().results
    result = json.loads((source / "result.json").read_text("utf-8"))
    result |= {"command": "identify", "verdict": None, "steps": [], "files": {"runs": {"release3": "release3.csv"}}}
    (tmp_path / "result.json").write_text(json.dumps(result), "utf-8")
    table = pd.read_csv(source / "release3.csv").rename(
        columns={"bearing.phi.after": "bearing.phi.model", "bearing.phi.residual_after": "bearing.phi.residual"}
    )
    table["bearing.phi.sd"] = np.where(table["time"] < 1, np.nan, 0.02)
    table.to_csv(tmp_path / "release3.csv", index=False)
    with opened(browser, write_page(tmp_path)) as page:
        assert page.inner_text("h1") == "RotaDamp is calibrated, and explains its data."
        assert page.locator(".tabs [role=tab]").count() == 1 and page.locator("#charts canvas").count() == 2
        blue = page.evaluate(
            """() => {
                const canvas = document.querySelector("#charts canvas"), {width, height} = canvas;
                const pixels = canvas.getContext("2d").getImageData(0, 0, width, height).data;
                let count = 0;
                for (let k = 0; k < pixels.length; k += 4)
                    count += pixels[k + 2] > pixels[k] + 60 && pixels[k + 3] > 99;
                return count;
            }"""
        )
        # a line of 1.5 px over the width of the page
        assert blue > 1000
        assert violations(page) == []


HOSTILE = "</script><script>document.title='taken'</script><img src=http://example.invalid/x onerror=alert(1)>"


def test_names_are_text_and_never_run(browser, tmp_path):
    """A component, an effect, a run and a reason may be called anything."""
    source = demo_run().results
    text = (source / "result.json").read_text("utf-8")
    for name in ("bearing", "coulomb_friction", "release3", "others promise more", "RotaDamp"):
        text = text.replace(name, json.dumps(f"{name}{HOSTILE}")[1:-1])
    result = json.loads(text)
    result["files"]["runs"] = {f"release3{HOSTILE}": "release3.csv"}
    (tmp_path / "result.json").write_text(json.dumps(result), "utf-8")
    table = pd.read_csv(source / "release3.csv")
    table.columns = [name.replace("bearing", f"bearing{HOSTILE}") for name in table.columns]
    table.to_csv(tmp_path / "release3.csv", index=False)
    with opened(browser, write_page(tmp_path)) as page:
        assert page.title() != "taken"
        assert HOSTILE in page.inner_text("h1")
        assert page.locator("img").count() == 0
        assert page.locator("script").count() == 2
