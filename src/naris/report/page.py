"""The page: a summary in plain words, then the sections in the order in which a careful reader asks for them."""

from __future__ import annotations

from importlib import resources

from naris.report import sections, words
from naris.report.data import ReportData
from naris.report.markup import Markup, element, join


def page(data: ReportData) -> str:
    """The whole HTML document."""
    style = resources.files("naris.report").joinpath("style.css").read_text(encoding="utf-8")
    parts = _sections(data)
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="generator", content=f"naris {data.versions.get('naris', '')}".strip()),
        element("title", data.title),
        element("style", Markup(style)),
    )
    links = [element("li", element("a", title, href=f"#{key}")) for key, title, _ in parts]
    body = element(
        "body",
        element(
            "main",
            _summary(data),
            element("nav", element("ol", links), aria_label="Sections"),
            [
                element("section", element("h2", title), content, id=key, aria_label=title)
                for key, title, content in parts
            ],
            element("footer", element("p", f"Made {data.made} by naris. For research only; not a medical device.")),
        ),
    )
    return "<!DOCTYPE html>\n" + element("html", head, body, lang="en") + "\n"


def _summary(data: ReportData) -> Markup:
    blocks = [
        ("What was done", words.done(data)),
        ("What came out", words.came_out(data)),
        ("How far to trust it", words.trust(data)),
    ]
    told = [
        element("div", element("h2", title), element("ul", [element("li", said) for said in sentences]))
        for title, sentences in blocks
        if sentences
    ]
    version = data.versions.get("naris", "")
    by = f"{data.made} · naris {version} · seed {data.seed}"
    return element(
        "header",
        element("h1", data.title),
        element("p", words.lede(data), class_="lede"),
        element("p", by, class_="small"),
        sections.headline(data) if data.networks else None,
        element("div", told, class_="summary"),
    )


def _sections(data: ReportData) -> list[tuple[str, str, Markup]]:
    """Key, title and content of every section that has something to show."""
    made = [
        ("anatomy", "The anatomy and its regions", sections.anatomy(data)),
        ("views", "What the camera sees", sections.views(data)),
        ("splits", "How the test pictures were chosen", sections.splits(data) if data.splits else None),
        ("results", "How often the region is named rightly", sections.results(data) if data.networks else None),
        ("confusion", "Which regions are confused", sections.confusions(data) if data.networks else None),
        ("calibration", "Can its probabilities be believed?", sections.calibrations(data)),
        ("pose", "How well the camera’s pose is found", sections.poses(data)),
        ("located", "Single pictures located", sections.located(data)),
        ("training", "Training", sections.training(data)),
        ("making", "How to make this page again", sections.making(data)),
    ]
    return [(key, title, join(content)) for key, title, content in made if content]
