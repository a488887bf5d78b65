"""The report in a real browser: what a person does with it works, and it asks no network for anything."""

import shutil

import numpy as np
import pytest

from coslobe.evaluate.report import embed
from coslobe.evaluate.report.page import Cell, Film, Gallery, Page, Picture, Plot, Table, Tile, Viewer, html
from coslobe.evaluate.report.plots import Axis, Series, svg
from coslobe.evaluate.verdicts import Verdict
from coslobe.render.images import write_exr, write_png

SIZE = 32


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("there is no chromium: `make test` installs it where apt is allowed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


def picture(folder, label: str, value: float) -> Picture:
    """A grey picture of one radiance, with a brighter pixel in row 3, column 20."""
    pixels = np.full((SIZE, SIZE, 3), value)
    pixels[3, 20] = (2.0, 4.0, 8.0)
    png, exr = folder / f"{label}.png", folder / f"{label}.exr"
    write_png(png, pixels)
    write_exr(exr, {"beauty": pixels}, {})
    return embed.png(png, label, exr=exr)


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    """A page with every kind of section."""
    folder = tmp_path_factory.mktemp("page")
    dark, bright = picture(folder, "coslobe", 0.1), picture(folder, "reference", 0.4)
    bar = {"colours": ["#000000", "#ffffff"], "ticks": ["−1 %", "0", "+1 %"], "note": "signed"}
    error = embed.png(folder / "coslobe.png", "error", bar=bar)
    rows = [[name, Cell(f"{value:g} %", value)] for name, value in (("a", 9.0), ("b", 10.0), ("c", -1.0))]
    film = [embed.jpeg(folder / f"{name}.png", str(i)) for i, name in enumerate(("coslobe", "reference"))]
    page = Page(
        title="a page",
        kind="tested",
        lead="All sections.",
        sections=[
            Film("The sequence", film, fps=20),
            Viewer("Two pictures", [dark, bright, error]),
            Gallery("Pictures", [error]),
            Plot(
                "A plot",
                svg([Series("line", [(1, 1), (10, 2)])], Axis("x", log=True), Axis("y"), [(3, "knee")]),
            ),
            Table("Numbers", ["", "value"], [*rows, ["d", Cell("–")]], groups=[("", 1), ("group", 1)]),
        ],
        command="coslobe eval",
        facts=[("made", "now")],
        tiles=[Tile("Error", "0.1", "%", "small")],
        verdicts=[Verdict("Fine", "good", "All is well.")],
    )
    path = folder / "report.html"
    path.write_text(html(page))
    return path


@pytest.fixture
def page(browser, page_file, request):
    """The page, opened; at the end nothing may have been logged, and nothing but the file asked for."""
    width, scheme = getattr(request, "param", (1280, "light"))
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True)
    page = context.new_page()
    trouble, asked = [], []
    page.on("console", lambda message: trouble.append(message.text))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(page_file.as_uri())
    page.wait_for_selector("section.viewer.with-viewer")
    yield page
    assert trouble == []
    assert [url for url in asked if not url.startswith(("data:", page_file.as_uri()))] == []
    context.close()


def pixel(page, side: str, row: int, column: int) -> list[int]:
    """What a canvas of the viewer holds."""
    return page.evaluate(
        "([side, x, y]) => [...document.querySelector(`canvas.${side}`).getContext('2d')"
        ".getImageData(x, y, 1, 1).data]",
        [side, column, row],
    )


def srgb(value: float) -> int:
    return round(255 * (1.055 * min(value, 1.0) ** (1 / 2.4) - 0.055))


def at(page, row: int, column: int) -> tuple[float, float]:
    """Where a pixel of the stage is in the window."""
    box = page.locator(".stage").bounding_box()
    return box["x"] + (column + 0.5) / SIZE * box["width"], box["y"] + (row + 0.5) / SIZE * box["height"]


def test_pictures_are_drawn_from_their_radiance(page):
    assert pixel(page, "left", 0, 0) == pytest.approx([srgb(0.1)] * 3 + [255], abs=1)
    assert pixel(page, "right", 0, 0) == pytest.approx([srgb(0.4)] * 3 + [255], abs=1)


def test_the_line_follows_slider_and_pointer(page):
    page.locator("input.split").fill("25")
    assert page.locator(".stage").evaluate("stage => stage.style.getPropertyValue('--split')") == "25%"
    clip = page.locator("canvas.left").evaluate("canvas => canvas.style.clipPath")
    assert clip.startswith("inset(0px 75% 0px 0px")
    page.locator(".stage").scroll_into_view_if_needed()
    page.mouse.move(*at(page, 16, 8))
    page.mouse.down()
    page.mouse.move(*at(page, 16, 24))
    page.mouse.up()
    assert float(page.locator("input.split").input_value()) == pytest.approx(100 * 24.5 / SIZE, abs=0.5)


def test_flipping_shows_one_picture_at_a_time(page):
    shown = page.locator(".stage")
    page.get_by_role("button", name="Flip").click()
    assert shown.get_attribute("data-shown") == "left"
    shown.click()
    assert shown.get_attribute("data-shown") == "right"
    assert page.locator(".left-tag").is_hidden()
    page.keyboard.press("f")
    assert shown.get_attribute("data-shown") == "left"
    page.get_by_role("button", name="Slider").click()
    assert shown.get_attribute("data-shown") == "both"


def test_exposure_changes_pictures_and_not_maps(page):
    page.locator(".exposure input").fill("1")
    assert page.locator(".exposure output").inner_text() == "+1 EV"
    assert pixel(page, "left", 0, 0)[:3] == pytest.approx([srgb(0.2)] * 3, abs=1)
    page.locator(".right-choice").select_option(label="error")
    page.wait_for_function(
        f"() => Math.abs(document.querySelector('canvas.right').getContext('2d')"
        f".getImageData(0, 0, 1, 1).data[0] - {srgb(0.1)}) <= 1"
    )


def test_the_pixel_under_the_pointer_is_read_out(page):
    page.locator(".stage").scroll_into_view_if_needed()
    page.mouse.move(*at(page, 3, 20))
    text = page.locator(".readout").inner_text()
    assert "row 3, column 20" in text
    assert text.count("2.000  4.000  8.000") == 2
    page.mouse.move(*at(page, 10, 10))
    text = page.locator(".readout").inner_text()
    assert "0.09998" in text  # 0.1 as half float
    assert "coslobe −75." in text


def test_zoom_keeps_the_pixel_that_was_clicked(page):
    page.locator(".stage").scroll_into_view_if_needed()
    page.mouse.dblclick(*at(page, 3, 20))
    assert page.locator(".zooms output").inner_text() == "200 %"
    page.mouse.move(*at(page, 3, 20))
    page.get_by_role("button", name="Zoom in").click()
    assert page.locator(".zooms output").inner_text() == "400 %"
    page.get_by_role("button", name="Reset").click()
    assert page.locator(".zooms output").inner_text() == "100 %"
    page.mouse.move(*at(page, 3, 20))
    assert "row 3, column 20" in page.locator(".readout").inner_text()


def test_tables_sort_by_value(page):
    names = lambda: [cell.inner_text() for cell in page.locator("tbody th").all()]  # noqa: E731
    heading = page.get_by_role("button", name="value")
    assert names() == ["a", "b", "c", "d"]
    heading.click()
    assert names() == ["b", "a", "c", "d"]  # by number, not by text; what has none is last
    assert page.locator("th[aria-sort=descending]").count() == 1
    heading.click()
    assert names() == ["c", "a", "b", "d"]
    heading.click()
    assert names() == ["a", "b", "c", "d"]


def test_the_sequence_plays(page):
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => document.querySelector('.player output').textContent === 'frame 1'")
    page.get_by_role("button", name="Pause").click()
    page.locator(".player input").fill("0")
    assert page.locator(".player output").inner_text() == "frame 0"


@pytest.mark.parametrize("page", [(390, "light"), (390, "dark"), (1280, "dark")], indirect=True)
def test_it_fits_a_phone_and_follows_the_colour_scheme(page):
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    dark = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    level = sum(int(part) for part in background[4:-1].split(",")) / 3
    assert (level < 64) == dark


def test_without_scripts_the_pictures_are_there(browser, page_file):
    context = browser.new_context(java_script_enabled=False, offline=True)
    page = context.new_page()
    page.goto(page_file.as_uri())
    assert page.locator(".compare").is_hidden()
    assert page.locator("section.viewer .card img").first.is_visible()
    context.close()
