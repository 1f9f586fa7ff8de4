"""The page of `deepfield serve --view` in Chromium, with several visitors: python tests/browser/view.py PROGRAM FILE

Needs Playwright (`pip install playwright`) and a Chromium, which CHROMIUM names [/usr/bin/chromium].
"""

import os
import re
import subprocess
import sys
import tempfile

from playwright.sync_api import expect, sync_playwright

TELLS = ".deepfield .told"
SCENE = """(version: 1, datasets: [(path: "DATA")],
    bookmarks: [(key: 1, name: "corner", camera: (eye: (3.0, 4.0, 5.0), target: (0.0, 0.0, 0.0)))])"""
TOUR = """(version: 1, dataset: (path: "DATA"), keyframes: [(around: (what: data)), (after: 1.0, orbit: 40.0)])"""


def begun(browser, address, messages):
    """The page of a new visitor, when its first picture is finished."""
    page = browser.new_context(viewport={"width": 900, "height": 700}).new_page()
    page.on("console", lambda message: messages.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.goto(address)
    finished(page)
    return page


def finished(page):
    expect(page.locator(TELLS)).to_have_text(re.compile("ms$"), timeout=60_000)


def pixels(page):
    return page.evaluate("document.querySelector('canvas').toDataURL()")


def looks(page):
    """Turns, zooms, chooses, goes, plays and picks; every step is another picture."""
    seen = [pixels(page)]

    def changed():
        # The page's policy lets no text be a script, with which Playwright waits by itself.
        for _ in range(600):
            if pixels(page) != seen[-1]:
                break
            page.wait_for_timeout(100)
        page.wait_for_timeout(400)
        finished(page)
        seen.append(pixels(page))

    page.mouse.move(300, 200)
    page.mouse.down()
    page.mouse.move(420, 260, steps=8)
    page.mouse.up()
    changed()
    page.mouse.wheel(0, -400)
    changed()
    page.locator("canvas").press("ArrowLeft")
    changed()
    page.get_by_label("colours").select_option("grey")
    changed()
    page.get_by_label("colour map").select_option("viridis")
    changed()
    page.get_by_label("scale").select_option("linear")
    changed()
    page.get_by_label("mode").select_option(index=3)
    changed()
    page.get_by_role("button", name="home").click()
    changed()
    page.get_by_role("button", name="corner").click()
    changed()
    for time in page.locator("input[type=range]").all():
        time.fill(time.get_attribute("max"))
        changed()
    page.get_by_role("button", name="tour").click()
    changed()
    page.locator("canvas").press("ArrowRight")
    changed()
    page.mouse.click(450, 300)
    expect(page.locator(TELLS)).to_have_text(re.compile(r"^\("), timeout=60_000)
    assert len(set(seen)) == len(seen), "a step changed nothing"


def beside(folder, name, text, file):
    path = os.path.join(folder, name)
    with open(path, "w", encoding="utf-8") as out:
        out.write(text.replace("DATA", os.path.abspath(file)))
    return path


def main(program, file):
    with tempfile.TemporaryDirectory() as folder:
        scene, tour = beside(folder, "a.scene.ron", SCENE, file), beside(folder, "a.tour.ron", TOUR, file)
        visit(program, [file, "--scene", scene, "--tour", tour])
    print("several visitors turned, zoomed, chose, played, picked and left")


def visit(program, data):
    server = [program, "serve", *data, "--view", "--visitors", "3", "--listen", "127.0.0.1:0"]
    with subprocess.Popen(server, stdout=subprocess.PIPE, text=True) as serving, sync_playwright() as playwright:
        try:
            address = re.search(r"http://\S+/", serving.stdout.readline())[0]
            browser = playwright.chromium.launch(executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=["--no-sandbox"])
            messages = []
            pages = [begun(browser, address, messages) for _ in range(3)]
            full = browser.new_context().new_page()
            assert full.goto(address).status == 503 and "All places are taken" in full.content()
            # One hangs up in the middle of a picture; the others go on, and who has waited gets its place without doing anything.
            pages[2].mouse.move(300, 200)
            pages[2].mouse.wheel(0, -300)
            pages.pop().context.close()
            for page in pages:
                looks(page)
            finished(full)
            looks(full)
            assert not messages, messages
            browser.close()
        finally:
            serving.terminate()


if __name__ == "__main__":
    main(*sys.argv[1:])
