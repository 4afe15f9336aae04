#!/usr/bin/env python3
"""Open a report in a real browser and use it as a reader would.

    python3 scripts/browser/report.py calib-quickstart/results/report.html [SCREENSHOTS]
    python3 scripts/browser/report.py calib-quickstart/results/report.html --check-pictures docs/guides
    python3 scripts/browser/report.py calib-quickstart/results/report.html --pictures docs/guides

Needs Chromium (`apt-get install chromium`); pinned Playwright goes into a virtual environment of its
own. Checks that the page loads without a console error or a request; that in both themes every chart
answers to the pointer, its legend, a drag, the wheel and the keyboard; that a zoomed rollout shows
every step; that pictures and numbers can be saved; that text has a contrast of at least 4.5; that no
screen scrolls sideways, cuts text, or hides the line of the choice; and that what is printed has its tables and no controls.
Writes screenshots of wide, narrow, dark and printed pages to SCREENSHOTS, if given.

`--pictures` writes the pictures of the guides instead: the top of the report with the words in it, and the
sensitivity curves. `--check-pictures` fails where the report has other words than the pictures that are kept.
Numbers may differ, as they do between processors.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree
from pathlib import Path

PINNED = ["playwright==1.65.2"]


def in_own_environment() -> None:
    """Starts this script again in a virtual environment with the pinned packages."""
    home = Path(os.environ.get("CALIB_TOOLS", Path(__file__).parents[2] / "target" / "tools")) / "browser"
    python = home / "bin" / "python"
    if Path(sys.prefix) == home:
        return
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PINNED], check=True)
    os.execv(python, [python, *sys.argv])


# Smallest contrast between the texts of the page and their background, with the text (WCAG 2.1).
CONTRAST = """() => {
  const rgba = (text) => {
    const numbers = (text.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
    // Mixed colours are written as shares.
    return text.startsWith("color(srgb") ? numbers.map((number, place) => (place < 3 ? 255 * number : number)) : numbers;
  };
  const light = ([r, g, b]) => [r, g, b].map((c) => c / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = rgba(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  let worst = [21, ""];
  for (const element of document.querySelectorAll("h1, h2, h3, p, li, td, th, a, button, summary, svg text")) {
    const text = element.textContent.trim();
    if (!text || !element.getClientRects().length) continue;
    const style = getComputedStyle(element);
    const ink = rgba(element.closest("svg") ? style.fill : style.color);
    const [a, b] = [light(ink), light(behind(element))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < worst[0]) worst = [ratio, `${element.tagName}: ${text.slice(0, 60)}`];
  }
  return worst;
}"""


# Cut text of the page: text that leaves its picture, text that the box of another element hides, and lines of the choice outside the
# visible part of their chart. Elements that scroll sideways, such as tables, do not count.
CUT = """() => {
  const wrong = [];
  const leaves = (inner, outer) => inner.left < outer.left - 1 || inner.right > outer.right + 1 || inner.top < outer.top - 1 || inner.bottom > outer.bottom + 1;
  for (const svg of document.querySelectorAll(".plot svg")) {
    const picture = svg.getBoundingClientRect();
    if (!picture.width) continue;
    const plot = svg.closest(".plot").getBoundingClientRect();
    const seen = { left: Math.max(plot.left, 0), right: Math.min(plot.right, innerWidth), top: -Infinity, bottom: Infinity };
    for (const text of svg.querySelectorAll("text"))
      if (leaves(text.getBoundingClientRect(), picture)) wrong.push(`'${text.textContent}' leaves ${svg.closest("figure").id}`);
    for (const mark of svg.querySelectorAll(".rules > *"))
      if (leaves(mark.getBoundingClientRect(), seen)) wrong.push(`a marked line of ${svg.closest("figure").id} is not in view`);
    if (picture.right > seen.right + 1) wrong.push(`${svg.closest("figure").id} is cut at the right`);
  }
  for (const element of document.querySelectorAll("h1, h2, h3, h4, p, li, dt, dd, summary, button, figcaption, .badge")) {
    if (!element.getClientRects().length || element.matches(".hidden, .skip") || element.closest(".scroll, pre")) continue;
    const box = element.getBoundingClientRect();
    if (box.left < -1 || box.right > innerWidth + 1) wrong.push(`'${element.textContent.slice(0, 40)}' leaves the screen`);
    if (element.scrollWidth > element.clientWidth + 1 && getComputedStyle(element).display !== "inline")
      wrong.push(`'${element.textContent.slice(0, 40)}' is wider than its box`);
  }
  return wrong;
}"""


def check(truth: bool, what: str) -> None:
    if not truth:
        raise SystemExit(f"report.py: {what}")


def use_chart(page, figure) -> None:
    """Reads, hides, zooms and walks over one chart."""
    name = figure.get_attribute("id")
    figure.scroll_into_view_if_needed()
    plot = figure.locator(".plot")
    plot.scroll_into_view_if_needed()

    def at(x: float, y: float) -> tuple[float, float]:
        """Returns a point in the plot. The plot may have moved, because the last click can be far above it."""
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    tip, axis, reset = figure.locator(".tip"), figure.locator(".wide svg .axis.x"), figure.locator("button.reset")

    shown = False
    for x in [0.25, 0.4, 0.5, 0.6, 0.75]:
        page.mouse.move(*at(x, 0.45))
        shown = shown or (tip.is_visible() and any(c.isdigit() for c in tip.inner_text()))
    check(shown, f"{name}: the pointer shows no values")

    keys = figure.locator("button.key")
    for i in range(min(keys.count(), 3)):
        key = keys.nth(i)
        curve = figure.locator(f".wide svg .series[data-series='{key.get_attribute('data-series')}']")
        # A horizontal line has no height, so Playwright considers it invisible.
        is_shown = lambda: curve.evaluate("e => getComputedStyle(e).display !== 'none' && getComputedStyle(e).visibility !== 'hidden'")
        before = is_shown()
        key.click()
        check(is_shown() != before, f"{name}: a click neither hides nor shows a curve")
        check((key.get_attribute("aria-pressed") == "true") != before, f"{name}: a key does not say what it did")
        key.press("Space")
        check(is_shown() == before, f"{name}: the keyboard neither hides nor shows a curve")

    whole = axis.inner_html()

    def zoomed(by: str) -> None:
        check(reset.is_visible() and axis.inner_html() != whole, f"{name}: {by} does not zoom")

    page.mouse.move(*at(0.3, 0.4))
    page.mouse.down()
    page.mouse.move(*at(0.6, 0.42), steps=4)
    page.mouse.up()
    zoomed("a drag")
    reset.click()
    check(axis.inner_html() == whole and reset.is_hidden(), f"{name}: the zoom cannot be undone")

    page.mouse.move(*at(0.5, 0.45))
    page.keyboard.down("Control")
    page.mouse.wheel(0, -200)
    page.keyboard.up("Control")
    figure.locator("button.reset:visible").wait_for(timeout=2000)
    zoomed("the wheel")
    figure.locator("button.zoom[data-zoom=out]").click()
    check(axis.inner_html() == whole, f"{name}: the button does not zoom out")

    plot.focus()
    live = figure.locator("[aria-live]")
    said = []
    for key in ["Home", "ArrowRight", "End", "ArrowDown", "+", "Shift+ArrowRight", "0"]:
        page.keyboard.press(key)
        said.append(live.inner_text())
        if key == "+":
            zoomed("the keyboard")
    check(all(said), f"{name}: the keyboard reads no values aloud: {said}")
    check(len({said[0], said[1], said[2]}) > 1, f"{name}: the arrow keys stay where they are")
    check(axis.inner_html() == whole, f"{name}: the key 0 does not show all")


def check_detail(page, figure) -> None:
    """Checks that a rollout at high zoom shows every step: as many points are drawn as the view has steps."""
    name = figure.get_attribute("id")
    figure.locator(".plot").focus()
    for _ in range(5):
        page.keyboard.press("+")
    drawn = figure.locator(".wide svg .series:not(.off) .scaled path").first.get_attribute("d").count("L")
    numbers = figure.evaluate("f => JSON.parse(f.querySelector('script').textContent)")
    steps = (numbers["x"]["max"] - numbers["x"]["min"]) / 32 / numbers["series"][0]["step"]
    check(min(steps, 20) <= drawn <= steps + 4, f"{name}: {drawn} points drawn of {steps:.0f} steps in view")
    page.keyboard.press("0")


def check_narrow(page) -> None:
    """Checks that the buttons of a chart work on a narrow screen as on a wide one."""
    figure = page.locator("figure.chart").first
    axis = figure.locator(".narrow svg .axis.x")
    whole = axis.inner_html()
    figure.locator("button.zoom[data-zoom=in]").click()
    check(axis.inner_html() != whole, "a chart does not zoom on a narrow screen")
    figure.locator("button.reset").click()
    check(axis.inner_html() == whole, "the zoom cannot be undone on a narrow screen")


def save_chart(page, figure, folder: Path) -> None:
    """Checks that every format can be saved, and is a file of its kind."""
    name = figure.get_attribute("id")
    buttons = figure.locator("button.save")
    for i in range(buttons.count()):
        with page.expect_download() as download:
            buttons.nth(i).click()
        file = folder / download.value.suggested_filename
        download.value.save_as(file)
        content = file.read_bytes()
        if file.suffix == ".svg":
            texts = [element.text for element in xml.etree.ElementTree.fromstring(content).iter() if element.text]
            check(len(texts) > 5, f"{name}: the saved SVG has no text")
        elif file.suffix == ".png":
            check(content[:4] == b"\x89PNG" and len(content) > 5000, f"{name}: the saved PNG is none")
        else:
            lines = content.decode().splitlines()
            check(lines[0].startswith("curve,") and len(lines) > 2, f"{name}: the saved CSV has no numbers")
    check(buttons.count() >= 2, f"{name}: nothing can be saved")


def check_print(page, pictures: Path | None) -> None:
    """Checks that the printed page has the reasons and the tables, and no buttons."""
    page.emulate_media(media="print", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    for control in ["nav", ".theme", ".tools", ".copy"]:
        check(page.locator(f"{control}:visible").count() == 0, f"{control} is printed")
    for content in ["article.card .why li", "#sensitivity details.data table"]:
        check(page.locator(content).first.is_visible(), f"'{content}' is not printed")
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    check(paper == "rgb(255, 255, 255)", f"paper is {paper} in the dark theme")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="null", color_scheme="light")
    printed = page.pdf(format="A4")
    check(printed[:4] == b"%PDF", "the page does not print")
    if pictures:
        (pictures / "printed.pdf").write_bytes(printed)


# Width and height of the picture in the guides, in pixels.
TOP = {"width": 1280, "height": 870}

# Readable texts of the picture, whatever the fonts: those of the title, the contents and the cards.
WORDS = """() => {
  const lines = [];
  for (const element of document.querySelectorAll("h1, nav a, h2 + p, article.card *")) {
    const box = element.getBoundingClientRect();
    const block = element.querySelector("h1, h2, h3, p, div, dl, dt, dd, ul, li, table, details");
    const text = element.innerText && element.innerText.replace(/\\s+/g, " ").trim();
    if (text && !block && box.height && lines[lines.length - 1] !== text) lines.push(text);
  }
  return lines;
}"""


def masked(text: str) -> str:
    """Replaces the numbers of a text."""
    return re.sub(r"<?[0-9][0-9.,e+-]*", "#", text)


def texts_of(drawing: Path) -> list[str]:
    """Returns the texts of an SVG, without numbers."""
    elements = xml.etree.ElementTree.parse(drawing).iter()
    return [masked(element.text.strip()) for element in elements if element.text and element.text.strip()]


def guides_pictures(playwright, chromium: str, report: Path, folder: Path, is_check: bool) -> None:
    """Writes the pictures of the guides, or compares their readable texts."""
    browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
    page = browser.new_context(viewport=TOP, color_scheme="light").new_page()
    page.goto(report.as_uri())
    words = page.evaluate(WORDS)
    curves = report.parent / "evaluate" / "figures" / "sensitivity.svg"
    written, kept = folder / "report.txt", folder / "sensitivity.svg"
    if is_check:
        again = f"run scripts/browser/report.py {report.name} --pictures {folder} and look at them"
        seen = written.read_text(encoding="utf-8").splitlines()
        differ = [line for line in words if masked(line) not in [masked(other) for other in seen]]
        check(not differ and len(words) == len(seen), f"{folder}/report.png is of another report, in {differ[:3]}; {again}")
        check(texts_of(curves) == texts_of(kept), f"{kept} is of another report; {again}")
        print(f"the pictures of {folder} have the words of this report")
    else:
        page.screenshot(path=folder / "report.png")
        written.write_text("\n".join(words) + "\n", encoding="utf-8")
        shutil.copyfile(curves, kept)
        print(f"{len(words)} lines of words in {written}")
    browser.close()


def main() -> None:
    arguments = sys.argv[1:]
    guides = None
    for option in ("--pictures", "--check-pictures"):
        if option in arguments:
            at = arguments.index(option)
            if at + 1 == len(arguments):
                raise SystemExit(__doc__)
            guides = (Path(arguments[at + 1]), option == "--check-pictures")
            del arguments[at : at + 2]
    if len(arguments) not in (1, 2):
        raise SystemExit(__doc__)
    report = Path(arguments[0]).resolve()
    pictures = Path(arguments[1]) if len(arguments) == 2 else None
    if pictures:
        pictures.mkdir(parents=True, exist_ok=True)
    chromium = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
    check(chromium is not None, "no Chromium on this machine; `apt-get install chromium`")
    check(report.is_file(), f"{report} does not exist; `calib evaluate` writes it")
    size = report.stat().st_size
    check(size < 20_000_000, f"the report is {size} bytes large, expected less than 20 MB")

    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        if guides is not None:
            guides_pictures(playwright, chromium, report, *guides)
            if not guides[1]:
                return
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        page = context.new_page()
        complaints, requests = [], []
        page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(report.as_uri())

        def picture(name: str) -> None:
            if pictures:
                page.screenshot(path=pictures / f"{name}.png", full_page=True)

        figures = page.locator("figure.chart")
        check(figures.count() > 0, "there is no chart")
        picture("wide-light")
        page.evaluate("document.querySelectorAll('details.more').forEach((more) => { more.open = true; })")
        for theme in ["light", "dark"]:
            page.emulate_media(color_scheme=theme)
            ratio, text = page.evaluate(CONTRAST)
            check(ratio >= 4.5, f"in the {theme} theme the contrast of '{text}' is {ratio:.1f}, expected 4.5")
            # A few charts of each kind are enough, because charts of a kind differ only in their data.
            for section in ["#sensitivity", "#rollouts", "#learning"]:
                for figure in page.locator(f"{section} figure.chart").all()[: 3 if theme == "light" else 1]:
                    use_chart(page, figure)
        page.evaluate("document.querySelectorAll('details.more').forEach((more) => { more.open = false; })")
        picture("wide-dark")
        for rollout in page.locator("#rollouts figure.chart").all():
            check_detail(page, rollout)
        with tempfile.TemporaryDirectory() as folder:
            for section in ["#sensitivity figure.chart", "#rollouts figure.chart", "#rollouts figure.still"]:
                if page.locator(section).count():
                    save_chart(page, page.locator(section).first, Path(folder))
        button = page.locator("button.theme")
        background = "getComputedStyle(document.body).backgroundColor"
        before = page.evaluate(background)
        button.click()
        check(page.evaluate(background) != before, "the theme button changes nothing")
        button.click()
        check(page.evaluate(background) == before, "the theme button does not change back")
        page.emulate_media(color_scheme="light")
        page.reload()

        for width in [360, 390, 768, 1300]:
            page.set_viewport_size({"width": width, "height": 844})
            page.evaluate("for (const more of document.querySelectorAll('details')) more.open = true")
            overflow = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            check(overflow <= 0, f"on a screen {width} pixels wide the page is {overflow} pixels too wide")
            cut = page.evaluate(CUT)
            check(not cut, f"on a screen {width} pixels wide {len(cut)} things are cut, such as: {'; '.join(cut[:5])}")
            if width == 390:
                check_narrow(page)
            page.evaluate("for (const more of document.querySelectorAll('details')) more.open = false")
            picture(f"narrow-{width}")
        page.set_viewport_size({"width": 1280, "height": 900})
        check_print(page, pictures)

        links = page.eval_on_selector_all("a[href^='#']", "all => all.map((a) => a.getAttribute('href'))")
        for link in links:
            check(page.locator(f"[id='{link[1:]}']").count() == 1, f"the link {link} leads nowhere")
        unnamed = page.eval_on_selector_all(
            "button, svg[role=img], table",
            "all => all.filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label'))).length",
        )
        check(unnamed == 0, f"{unnamed} controls or pictures have no name for a screen reader")
        outside = [url for url in requests if not url.startswith(("file:", "data:"))]
        check(not outside, f"the page asks the network for {outside[:3]}")
        check(not complaints, f"the console says {complaints[:3]}")
        print(f"{figures.count()} charts, {len(links)} links, {size / 1e6:.1f} MB: the report works in a browser")
        browser.close()


if __name__ == "__main__":
    in_own_environment()
    main()
