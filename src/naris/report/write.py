"""Writing the page."""

from __future__ import annotations

from pathlib import Path

from naris.core.atomic import write_text
from naris.report.data import ReportData


def write_report(data: ReportData, path: Path) -> Path:
    """Writes the report as one HTML file that needs nothing else, whole or not at all, and returns its path.

    The page is a function of the data alone: the same data give the same bytes.

    Raises:
        DiskFull: if there is no room.
    """
    from naris.report.page import page

    write_text(path, page(data))
    return path
