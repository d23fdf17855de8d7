"""What must hold of every page whatever it shows: WCAG 2.2 AA where a program can tell, and nothing cut.

axe-core is no dependency: these are the checks of it that matter here, written from the text of WCAG. Each gives
sentences that name the element; an empty list is a page without violations.
"""

from __future__ import annotations

from pathlib import Path

VIOLATIONS = Path(__file__).with_suffix('.js').read_text()
FOCUS = """() => {
  const e = document.activeElement, style = getComputedStyle(e), box = e.getBoundingClientRect();
  const ring = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2;
  const inside = box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth;
  return { id: e.id || e.textContent.trim().slice(0, 20), tag: e.tagName, ring, inside, href: e.href || '' };
}"""
