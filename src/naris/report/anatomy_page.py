"""One anatomy as a page: from three sides, cut in three planes, down its passages, and what is known of it."""

from __future__ import annotations

from collections.abc import Mapping

from naris.airway.block import Block
from naris.core.anatomy import Anatomy
from naris.report.anatomy_figure import anatomy_caption, anatomy_figure
from naris.report.anatomy_sheet import sheet
from naris.report.data import AnatomyView
from naris.report.document import document
from naris.report.markup import element, figure, table


def anatomy_page(anatomy: Anatomy, region_set: str, facts: Mapping[str, str], scan: Block | None = None) -> str:
    """A self-contained HTML document.

    Args:
        anatomy: with its passages, in mm.
        region_set: the name of the set whose regions are drawn in colour.
        facts: what else to say, each under a short label.
        scan: the CT that it was found in, to be seen behind the cuts.

    Raises:
        RegionError: if the anatomy has no such region set.
    """
    view = AnatomyView(anatomy, region_set)
    passages = [
        [one.name, f"{one.length_mm:.0f} mm", f"{one.clearance_mm.min():.2f}–{one.clearance_mm.max():.2f} mm"]
        for one in anatomy.passages
    ]
    return document(
        anatomy.name,
        element("section", figure(anatomy_figure(view), anatomy_caption(view), "wide")),
        element("section", table(["", ""], [[label, said] for label, said in facts.items()], "prose")),
        sheet(anatomy, view.regions, scan),
        element("section", table(["passage", "length", "from its middle to the wall"], passages)) if passages else None,
    )
