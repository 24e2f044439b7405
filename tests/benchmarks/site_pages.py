"""Whether all pages of the site fit: on screens and telephones, in the light and in the dark.

PYTHONPATH=.:tests python tests/benchmarks/site_pages.py SITE [PICTURES]

SITE is the folder of the built site. A page is at fault if it scrolls sideways, or if something stands out of its
column and nothing around it scrolls. Code and tables of the guide must fit on screens without scrolling. With a folder
for PICTURES, each page is drawn there.
"""

import sys
from pathlib import Path

from browser import Browser
from page_fit import misfits

WIDTHS = {"screen": 1280, "telephone": 390}
SCHEMES = "light", "dark"
HEIGHT, TALLEST = 900, 8000
"""Of the window, and of a picture of a page, at most [pixels]."""
LISTS = "search", "genindex", "py-modindex"


def main(site: Path, pictures: Path | None) -> bool:
    pages = [path for path in sorted(site.rglob("*.html")) if "drawn" not in path.parts and path.stem not in LISTS]
    faulty = 0
    with Browser() as browser:
        for path in pages:
            name, found = path.relative_to(site).with_suffix("").as_posix(), set()
            browser.open(path)
            for kind, width in WIDTHS.items():
                for scheme in SCHEMES:
                    browser.resize(width, HEIGHT)
                    browser.prefer(scheme)
                    found |= {f"{kind}: {fault}" for fault in misfits(browser, kind == "screen" and "/" not in name)}
                    if pictures is not None:
                        browser.resize(width, min(browser.run("document.documentElement.scrollHeight"), TALLEST))
                        browser.screenshot(pictures / f"{name.replace('/', '-')}-{kind}-{scheme}.png")
            faulty += bool(found)
            for fault in sorted(found):
                print(f"{name}: {fault}")
    print(f"{len(pages)} pages, {len(WIDTHS) * len(SCHEMES)} views of each; {faulty} at fault")
    return bool(faulty)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]) if len(sys.argv) > 2 else None))
