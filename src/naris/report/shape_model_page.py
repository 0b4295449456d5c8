"""A shape model as a page: how good it is with how many modes, and its mean nose."""

from __future__ import annotations

from collections.abc import Mapping

from naris.anatomy.shape_model import ShapeModel
from naris.report.anatomy_figure import anatomy_caption, anatomy_figure
from naris.report.anatomy_sheet import sheet
from naris.report.charts import shape_curve_charts
from naris.report.data import AnatomyView
from naris.report.document import document
from naris.report.markup import element, figure, table

_CAPTION = (
    "By the number of modes. Compactness: the share of the variance that they have. Generalisation: how far a nose "
    "that was left out is from the nearest that a model of all others can make. Specificity: how far noses drawn from "
    "the model are from the nearest that it was built of. Distances are root mean squares over corresponding "
    "vertices; of both, less is better."
)


def shape_model_page(model: ShapeModel, facts: Mapping[str, str]) -> str:
    """A self-contained HTML document.

    Args:
        model: whose mean has regions; the first set is drawn.
        facts: what else to say, each under a short label.

    Raises:
        RegionError: if the mean has no regions.
    """
    view = AnatomyView(model.mean, model.mean.region_set().name)
    curves = figure(shape_curve_charts(model.curves), _CAPTION, "wide") if model.curves is not None else None
    return document(
        f"shape model of {model.patients} noses",
        element("section", table(["", ""], [[label, said] for label, said in facts.items()])),
        element("section", curves) if curves is not None else None,
        element("section", element("h2", "The mean"), figure(anatomy_figure(view), anatomy_caption(view), "wide")),
        sheet(model.mean, view.regions),
    )
