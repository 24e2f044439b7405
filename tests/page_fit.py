"""Whether pages of the site fit into a window."""

from browser import Browser

_FIND = """(whole => {
  const faults = [], page = document.documentElement, article = document.querySelector("article");
  const column = article.getBoundingClientRect(), scrolls = e => /auto|scroll/.test(getComputedStyle(e).overflowX);
  if (page.scrollWidth > innerWidth) faults.push(`the page is ${page.scrollWidth} wide`);
  for (const e of article.querySelectorAll("*")) {
    const box = e.getBoundingClientRect(), style = getComputedStyle(e), name = `${e.tagName}.${e.className}`;
    if (!box.width || style.position === "absolute" || e.closest("svg, mjx-container")) continue;
    let inside = false;
    for (let a = e.parentElement; a !== article; a = a.parentElement) inside ||= scrolls(a);
    const beyond = Math.round(box.right - column.right), more = e.scrollWidth - e.clientWidth;
    if (!inside && beyond > MARGIN) faults.push(`${name} ends ${beyond} beyond its column`);
    if (style.overflowX === "hidden" && more > 1) faults.push(`${name} is cut`);
    if (whole && more > 1 && e.matches("pre, :has(> table)"))
      faults.push(`${more} too wide: ${e.innerText.slice(0, 60)}`);
    if (e.tagName === "IMG" && e.loading !== "lazy" && !e.naturalWidth) faults.push(`${e.src} is missing`);
  }
  return faults;
})"""
_MARGIN = 9
"""How far headings and tables of the theme reach beyond the column [pixels]."""


def misfits(browser: Browser, whole: bool) -> list[str]:
    """What of the open page is wider than its place, and nothing around it scrolls.

    Where code and tables are to be seen whole, they are not to scroll either.
    """
    return browser.run(f"{_FIND.replace('MARGIN', str(_MARGIN))}({str(whole).lower()})")
