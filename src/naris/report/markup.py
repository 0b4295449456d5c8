"""Small pieces of HTML and SVG. Text is escaped unless it is `Markup`; attributes always are."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

_VOID = {"img", "meta", "br", "hr", "line", "rect", "circle", "path", "polyline", "image"}


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


Child = str | Markup | None | Iterable["Child"]
"""What an element may hold: text (escaped), markup, nothing, or several of these."""


def element(tag: str, *children: Child, **attributes: str | float | bool | None) -> Markup:
    """`<tag …>children</tag>`.

    In the names of attributes an underscore stands for a hyphen and one at the end is dropped (`class_`); None and
    False leave the attribute out, True writes it without a value.
    """
    written = "".join(_attribute(name, value) for name, value in attributes.items())
    if tag in _VOID:
        return Markup(f"<{tag}{written}/>")
    return Markup(f"<{tag}{written}>{join(*children)}</{tag}>")


def join(*children: Child, separator: str = "") -> Markup:
    """Children one after another, each escaped if it is not markup."""
    return Markup(html.escape(separator).join(_flat(children)))


def table(head: Sequence[Child], rows: Iterable[Sequence[Child]], class_: str | None = None) -> Markup:
    """A table whose first column names the rows; it scrolls sideways where the window is narrow.

    Headings that are all empty are left out.
    """
    body = [
        element("tr", element("th", row[0], scope="row"), [element("td", cell) for cell in row[1:]]) for row in rows
    ]
    top = element("thead", element("tr", [element("th", cell, scope="col") for cell in head])) if any(head) else None
    return element("div", element("table", top, element("tbody", body), class_=class_), class_="scroll")


def figure(content: Child, caption: Child, class_: str | None = None) -> Markup:
    """A figure with its caption."""
    return element("figure", content, element("figcaption", caption), class_=class_)


def _flat(children: Iterable[Child]) -> Iterable[str]:
    for child in children:
        if child is None:
            continue
        if isinstance(child, Markup):
            yield child
        elif isinstance(child, str):
            yield html.escape(child)
        else:
            yield from _flat(child)


def _attribute(name: str, value: str | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    name = name.removesuffix("_").replace("_", "-")
    if value is True:
        return f" {name}"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return f' {name}="{html.escape(text)}"'
