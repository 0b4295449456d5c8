"""One self-contained HTML page about a run: what was done, what came out, and how far to trust it.

Fill a `ReportData`, then `write_report(data, path)`.
"""

from naris.report.data import (
    SINHA_2018,
    AnatomyView,
    Line,
    LocatedFrame,
    NearestPair,
    NetworkResult,
    Published,
    ReportData,
    Split,
    Stage,
    TrainingCurve,
    ViewSet,
)
from naris.report.nearest import Nearest, nearest_views
from naris.report.scores import Calibration, PoseErrors, RunScore, TestResult
from naris.report.write import write_report

__all__ = [
    "SINHA_2018",
    "AnatomyView",
    "Calibration",
    "Line",
    "LocatedFrame",
    "Nearest",
    "NearestPair",
    "NetworkResult",
    "PoseErrors",
    "Published",
    "ReportData",
    "RunScore",
    "Split",
    "Stage",
    "TestResult",
    "TrainingCurve",
    "ViewSet",
    "nearest_views",
    "write_report",
]
