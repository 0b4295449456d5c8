"""The frame of a self-contained page: its style comes with it, and it needs nothing from elsewhere."""

from __future__ import annotations

from importlib import resources

from naris.report.markup import Child, Markup, element


def document(title: str, *parts: Child) -> str:
    """A whole HTML document of some parts under a title."""
    style = resources.files("naris.report").joinpath("style.css").read_text(encoding="utf-8")
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", Markup(style)),
    )
    main = element("main", element("header", element("h1", title)), *parts)
    return "<!DOCTYPE html>\n" + element("html", head, element("body", main), lang="en") + "\n"
