"""Whether all pages of the site fit: on screens and telephones, in the light and in the dark.

PYTHONPATH=.:tests python tests/benchmarks/site_pages.py SITE [PICTURES]

SITE is the folder of the built site. A page is at fault if it scrolls sideways, or if something stands out of its column
and nothing around it scrolls. Code of the guide must fit on screens without scrolling. With a folder for PICTURES, each
page is drawn there in full.
"""

import sys
from pathlib import Path

from browser import Browser

WIDTHS = {"screen": 1280, "telephone": 390}
SCHEMES = "light", "dark"
FIND = """(() => {
  const wide = innerWidth, faults = [], scrolls = e => /auto|scroll/.test(getComputedStyle(e).overflowX);
  if (document.documentElement.scrollWidth > wide) faults.push(`the page is ${document.documentElement.scrollWidth} wide`);
  const column = document.querySelector("article").getBoundingClientRect();
  for (const e of document.querySelectorAll("article *")) {
    const box = e.getBoundingClientRect(), style = getComputedStyle(e);
    if (!box.width || style.position === "absolute" || e.closest("svg, mjx-container, .sr-only")) continue;
    let inside = false;
    for (let a = e.parentElement; a && a.tagName !== "ARTICLE"; a = a.parentElement) inside ||= scrolls(a);
    if (!inside && box.right > column.right + 9)  // headings and tables of the theme reach 8 pixels into the margin
      faults.push(`${e.tagName}.${e.className} ends ${Math.round(box.right - column.right)} outside`);
    if (style.overflowX === "hidden" && e.scrollWidth > e.clientWidth + 1) faults.push(`${e.tagName}.${e.className} is cut`);
    if (PROGRAMS && e.tagName === "PRE" && e.scrollWidth > e.clientWidth + 1)
      faults.push(`code is ${e.scrollWidth - e.clientWidth} too wide: ${e.textContent.split("\\n").sort((a, b) => b.length - a.length)[0]}`);
  }
  for (const e of document.querySelectorAll("article img")) if (!e.complete || !e.naturalWidth) faults.push(`${e.src} is missing`);
  return faults;
})()"""


def main(site: Path, pictures: Path | None) -> int:
    pages = [path for path in sorted(site.rglob("*.html")) if "drawn" not in path.parts and path.stem not in ("search", "genindex")]
    faulty = 0
    with Browser() as browser:
        for path in pages:
            name, found = path.relative_to(site).with_suffix("").as_posix(), set()
            browser.open(path)
            for width_name, width in WIDTHS.items():
                browser.resize(width, 900)
                programs = width_name == "screen" and "/" not in name
                for scheme in SCHEMES:
                    browser.prefer(scheme)
                    found |= {f"{width_name}: {fault}" for fault in browser.run(FIND.replace("PROGRAMS", str(programs).lower()))}
                    if pictures is not None:
                        height = browser.run("document.documentElement.scrollHeight")
                        browser.resize(width, min(height, 8000))
                        browser.screenshot(pictures / f"{name.replace('/', '-')}-{width_name}-{scheme}.png")
                        browser.resize(width, 900)
            faulty += bool(found)
            for fault in sorted(found):
                print(f"{name}: {fault}")
    print(f"{len(pages)} pages, {len(WIDTHS) * len(SCHEMES)} views of each; {faulty} at fault")
    return bool(faulty)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else None))
