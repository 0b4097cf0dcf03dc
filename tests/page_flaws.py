"""What is wrong with a page: by axe, in light and dark, on a phone, and by the keyboard alone."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from playwright.sync_api import Page as Tab


def findings(tab: Tab) -> list[tuple[str, Any, str]]:
    """Return what axe finds on a page as it is now: rule, element and remedy."""
    if not tab.evaluate("Boolean(window.axe)"):
        axe = (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")
        tab.evaluate(f"(() => {{ {axe} }})()")
    found = tab.evaluate("axe.run(document, {resultTypes: ['violations'], preload: false})")
    return [
        (each["id"], each["nodes"][0]["target"], each["nodes"][0]["failureSummary"])
        for each in found["violations"]
    ]


PHONE = {"width": 375, "height": 740}

CUT = """[...document.querySelectorAll('button, input, select, .strip, a')].filter((each) => {
  const { left, right, width } = each.getBoundingClientRect();
  return width > 1 && !each.closest('.panel, .grid, dialog') && (left < 0 || right > innerWidth + 1);
}).map((each) => each.id || each.textContent)"""
"""The controls of a page that its window cuts off."""

RING = """(() => {
  const focused = document.activeElement;
  const { outlineStyle, outlineColor, boxShadow } = getComputedStyle(focused);
  const ring = [outlineStyle, outlineColor, boxShadow.slice(0, 12)].join();
  if (focused.matches('body, g') || ring === 'solid,rgb(255, 255, 255),rgb(0, 0, 0)') return '';
  return focused.outerHTML.slice(0, 90);
})()"""
"""The element that has the keyboard's focus, if that is not seen; a handle or key shows it by its own ink."""


def flaws(tab: Tab, stops: int = 40) -> list[Any]:
    """Return what is wrong with a page in light, in dark, on a phone, and by the keyboard alone."""
    found: list[Any] = []
    for scheme in ("dark", "light"):
        tab.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        found += [(scheme, *each) for each in findings(tab)]
    size = tab.viewport_size
    tab.set_viewport_size(PHONE)  # type: ignore[arg-type]
    tab.wait_for_timeout(50)
    found += [("cut", each) for each in tab.evaluate(CUT)] + findings(tab)
    assert size is not None
    tab.set_viewport_size(size)
    reached = set()
    for _ in range(stops):
        tab.keyboard.press("Tab")
        reached.add(tab.evaluate("document.activeElement.id"))
        found += [("no ring", each) for each in [tab.evaluate(RING)] if each]
    found += [
        ("not reached", each)
        for each in {"help-button", "frame", "play"} - reached
        if tab.evaluate(f"Boolean(document.getElementById('{each}'))")
    ]
    tab.evaluate("document.activeElement.blur()")
    tab.keyboard.press("?")
    if not tab.evaluate("document.getElementById('help').open"):
        found.append("no help")
    found += findings(tab)
    tab.keyboard.press("Escape")
    return found
