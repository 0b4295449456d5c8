"""Whether images that name one series are of one scan, judged by what else their headers say.

Identifiers are compared and never told. What may legitimately differ within a series (acquisitions one after another,
thicknesses, a kernel) is no reason to refuse it; what two scans have been mixed by is often seen there first, so it is
told. The pixels are judged by `naris.ct.continuity`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from naris.ct.scan import Finding
from naris.ct.series import Image
from naris.ct.slices import Stack
from naris.errors import ScanError

_SAME_THICKNESS = 0.05  # share
_GAP = 1.2  # steps of more than so many thicknesses leave something out
_SAME_TILT_DEG = 1.0
_AXIAL = 0.7  # the cosine between the normal and the axis of the body, from which a tilt of the gantry shows


def check_one_scan(images: Sequence[Image], stack: Stack) -> tuple[Finding, ...]:
    """See that images, in the order of the stack, are of one scan, and tell what may speak against it.

    Raises:
        ScanError: if they are of several studies or have positions in several frames of reference.
    """
    findings = [
        *_one_value("study", [image.origin.study for image in images]),
        *_one_value("frame of reference", [image.origin.frame_of_reference for image in images]),
        *_acquisitions(images),
        *_thickness(images, float(stack.gaps_mm.mean())),
        *_tilt(images, stack),
    ]
    kernels = {image.origin.kernel for image in images}
    if len(kernels) > 1:
        text = f"the slices were made with {len(kernels)} convolution kernels: two scans may be mixed"
        findings.append(Finding("kernels", text, "warning"))
    return tuple(findings)


def _one_value(what: str, named: Sequence[str | None]) -> list[Finding]:
    known = [one for one in named if one is not None]  # an image that names none says nothing
    counts = Counter(known)
    if len(counts) <= 1:
        return []
    # Some programs that take names out of files give every file identifiers of its own: then they tell nothing.
    if len(counts) == len(known):
        return [Finding(what, f"every image names a {what} of its own; they were taken to have one", "warning")]
    sizes = ", ".join(str(size) for _, size in counts.most_common(5))
    raise ScanError(
        f"images that name one {what}",
        f"{len(counts)} of {sizes} images under the name of one series",
        "separate the scans that are mixed here",
    )


def _acquisitions(images: Sequence[Image]) -> list[Finding]:
    """Acquisitions follow each other along the table, or are one; those that take turns are often two scans."""
    numbers = [image.origin.acquisition for image in images]
    runs = 1 + sum(one != other for one, other in pairwise(numbers))
    if runs == len(set(numbers)):
        return []
    text = f"the slices of {len(set(numbers))} acquisitions take turns: two scans may be mixed"
    return [Finding("acquisitions", text, "warning")]


def _thickness(images: Sequence[Image], step_mm: float) -> list[Finding]:
    told = [image.origin.thickness_mm for image in images if image.origin.thickness_mm]
    if not told:
        return []
    low, high = min(told), max(told)
    if high > low * (1 + _SAME_THICKNESS):
        text = f"slices are {low:.3g} to {high:.3g} mm thick: two scans may be mixed"
        return [Finding("thicknesses", text, "warning")]
    if step_mm > _GAP * high:
        text = f"slices {high:.3g} mm thick lie {step_mm:.3g} mm apart: there are gaps, or slices are missing"
        return [Finding("gaps", text, "warning")]
    return []


def _tilt(images: Sequence[Image], stack: Stack) -> list[Finding]:
    told = [abs(image.origin.tilt_deg) for image in images if image.origin.tilt_deg is not None]
    if not told or abs(float(stack.normal[2])) < _AXIAL:
        return []
    if max(told) - min(told) <= _SAME_TILT_DEG and abs(float(np.median(told)) - stack.tilt_deg) <= _SAME_TILT_DEG:
        return []
    span = f"{min(told):.1f}°" if max(told) - min(told) < 0.1 else f"{min(told):.1f} to {max(told):.1f}°"
    text = f"the headers tell a gantry tilt of {span}, the positions {stack.tilt_deg:.1f}°; the positions were believed"
    return [Finding("tilt told", text, "warning")]
