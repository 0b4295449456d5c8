"""The page stands alone, says what the data say, and survives whatever the data hold."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.core.anatomy import SlabRegions
from naris.report import ReportData, TrainingCurve, ViewSet, write_report
from naris.report.page import page
from naris.report.sections import anatomy


def parsed(text: str) -> ElementTree.Element:
    """The page as a tree: it is well-formed XML beneath its doctype, so every tag closes."""
    doctype, _, rest = text.partition("\n")
    assert doctype == "<!DOCTYPE html>"
    return ElementTree.fromstring(re.sub(r' xmlns="[^"]*"', "", rest))


def words(element: ElementTree.Element) -> str:
    return " ".join("".join(element.itertext()).split())


def table_with(tree: ElementTree.Element, heading: str) -> list[list[str]]:
    for table in tree.iter("table"):
        rows = [[words(cell) for cell in row] for row in table.iter("tr")]
        if heading in rows[0]:
            return rows[1:]
    raise AssertionError(f"no table with the heading {heading}")


@pytest.fixture(scope="module")
def text(reproduce_data: ReportData) -> str:
    return page(reproduce_data)


@pytest.fixture(scope="module")
def tree(text: str) -> ElementTree.Element:
    return parsed(text)


def test_page_needs_nothing_else(tree: ElementTree.Element, reproduce_data: ReportData) -> None:
    for element in tree.iter():
        assert element.tag not in {"script", "link", "iframe", "object", "embed", "base"}
        for name, value in element.attrib.items():
            if name.split("}")[-1] in {"src", "href", "srcset", "poster", "data"}:
                assert value.startswith(("data:image/", "#"))
            assert not name.startswith("on")
    style = next(tree.iter("style")).text or ""
    assert "url(" not in style
    assert "@import" not in style
    assert len(list(tree.iter("img"))) == 30 + 6 + 3  # views, pairs, located


def test_links_lead_to_sections(tree: ElementTree.Element) -> None:
    targets = {element.get("id") for element in tree.iter() if element.get("id")}
    links = [element.get("href", "")[1:] for element in tree.iter("a")]
    assert links
    assert set(links) <= targets
    assert len(targets) == len([element for element in tree.iter() if element.get("id")])


def test_every_picture_and_chart_is_described(tree: ElementTree.Element) -> None:
    assert all(image.get("alt") for image in tree.iter("img"))
    assert all(drawing.get("aria-label") for drawing in tree.iter("svg"))


def test_table_repeats_the_data(tree: ElementTree.Element, reproduce_data: ReportData) -> None:
    published, *rows = table_with(tree, "Errors between non-neighbours")
    assert published[2] == "76.5 ± 1.2 %"
    tests = [(network, test) for network in reproduce_data.networks for test in network.tests]
    assert len(rows) == len(tests)
    neighbours = reproduce_data.anatomy.regions.neighbours
    for row, (network, test) in zip(rows, tests, strict=True):
        assert row[:2] == [network.label, reproduce_data.split(test.split).label]
        numbers = [float(number) for number in re.findall(r"\d+\.\d+", " ".join(row[2:]))]
        accuracies = [np.trace(run.confusion) / run.confusion.sum() for run in test.runs]
        expected = [100 * np.mean(accuracies)]
        if len(accuracies) > 1:
            expected.append(100 * np.std(accuracies, ddof=1))
        assert test.interval is not None
        expected += [100 * end for end in test.interval]
        counts = sum(run.confusion for run in test.runs)
        expected.append(100 * counts.sum(axis=1).max() / counts.sum())
        expected.append(100 * counts[~neighbours].sum() / (counts.sum() - np.trace(counts)))
        assert numbers[: len(expected) - 2] == pytest.approx(expected[:-2], abs=0.051)
        assert numbers[len(expected) - 1] == pytest.approx(expected[-1], abs=0.051)


def test_no_wrong_answers_are_not_none_of_them_far(bare_data: ReportData) -> None:
    (network,) = bare_data.networks
    (test,) = network.tests
    right = replace(test, runs=(replace(test.runs[0], confusion=np.diag([3, 4, 5, 6])),))
    tree = parsed(page(replace(bare_data, networks=(replace(network, tests=(right,)),))))
    assert table_with(tree, "Errors between non-neighbours")[0][5] == "none wrong"
    near = replace(right, runs=(replace(test.runs[0], confusion=np.eye(4, k=1, dtype=int)),))
    tree = parsed(page(replace(bare_data, networks=(replace(network, tests=(near,)),))))
    assert table_with(tree, "Errors between non-neighbours")[0][5] == "0.0 % of 3"


def test_a_training_of_one_value_is_told_and_marked(bare_data: ReportData) -> None:
    (network,) = bare_data.networks
    short = replace(network, training=(TrainingCurve(0, np.array([0.76]), 1.0, 1.0),), step="100 steps")
    made = page(replace(bare_data, networks=(short,)))
    assert "one value only (0.76)" in made
    assert 'class="dots q0"' in made


def test_every_part_is_told(tree: ElementTree.Element, reproduce_data: ReportData) -> None:
    told = words(tree)
    for expected in (
        reproduce_data.title,
        reproduce_data.command,
        reproduce_data.anatomy.anatomy.source,
        reproduce_data.published.citation,  # type: ignore[union-attr]
        *reproduce_data.anatomy.regions.names,
        *(split.explanation for split in reproduce_data.splits),
        *(stage.made for stage in reproduce_data.stages),
        *(frame.name for frame in reproduce_data.located),
        *reproduce_data.versions,
        "not localised",
        "rate.start",
        "0.001",
        "simulated",
        "no medical device",
        "one anatomy",
    ):
        assert expected in told


@pytest.mark.parametrize(
    ("frame", "says", "not_said"),
    [
        ("LPS", "x points to the left of the patient, y backwards, z upwards.", "as the file has them"),
        ("mean", "y points from the nostril back to the nasopharynx", "of the patient"),
        ("phantom", "axes of the frame “phantom” as the file has them", "of the patient"),
    ],
)
def test_axes_are_told_as_far_as_they_are_known(bare_data: ReportData, frame: str, says: str, not_said: str) -> None:
    view = bare_data.anatomy
    said = anatomy(replace(bare_data, anatomy=replace(view, anatomy=view.anatomy.with_(frame=frame))))
    caption = " ".join(said.split("<figcaption>")[1].split("</figcaption>")[0].split())
    assert says in caption
    assert not_said not in caption


def test_matrices_of_every_run(tree: ElementTree.Element, reproduce_data: ReportData) -> None:
    matrices = [drawing for drawing in tree.iter("svg") if "matrix" in drawing.get("class", "")]
    tests = [test for network in reproduce_data.networks for test in network.tests]
    shown = [drawing for drawing in matrices if "small" in drawing.get("class", "")]
    counts = [
        sorted(int(text.text or 0) for text in drawing.iter("text") if (text.text or "").isdigit()) for drawing in shown
    ]
    expected = [
        sorted(int(n) for n in run.confusion.ravel() if n) for test in tests if len(test.runs) > 1 for run in test.runs
    ]
    assert counts == expected
    assert len(matrices) - len(shown) == len(tests)


def test_same_data_same_bytes_in_the_file(text: str, reproduce_data: ReportData, tmp_path: Path) -> None:
    path = tmp_path / "new" / "report.html"
    assert write_report(reproduce_data, path) == path
    assert path.read_text(encoding="utf-8") == text
    assert list(path.parent.iterdir()) == [path]


def test_size_stays_small(reproduce_data: ReportData) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (6, 300, 300, 3), dtype=np.uint8)
    views = ViewSet("Noise", "Pictures that no codec can shrink.", (noise, noise, noise, noise))
    many = replace(reproduce_data, views=(views, views), located=reproduce_data.located * 8)
    assert len(page(many).encode()) < 6e6


def test_bare_data_make_a_page(bare_data: ReportData) -> None:
    tree = parsed(page(bare_data))
    sections = {element.get("id") for element in tree.iter("section")}
    assert sections == {"anatomy", "splits", "results", "confusion", "making"}
    assert "nan" not in words(tree).lower().replace("anatomy", "")
    assert "trained only once" in words(tree)
    assert "published" not in words(tree)


def test_no_results_at_all(bare_data: ReportData) -> None:
    tree = parsed(page(replace(bare_data, networks=(), splits=())))
    assert {element.get("id") for element in tree.iter("section")} == {"anatomy", "making"}


HOSTILE = "<script>alert('1')</script> & \"quoted\" <img src=http://x.invalid/y onerror=z>"


def test_hostile_names_are_text(reproduce_data: ReportData) -> None:
    anatomy = reproduce_data.anatomy.anatomy
    names = tuple(f"{HOSTILE} {i}" for i in range(4))
    regions = SlabRegions("paper", names, "mean", 1, (-30.0, -15.0, 0.0))
    hostile = replace(
        reproduce_data,
        title=HOSTILE,
        command=HOSTILE,
        made=HOSTILE,
        anatomy=replace(
            reproduce_data.anatomy,
            anatomy=anatomy.with_(name=HOSTILE, source=HOSTILE, regions={"paper": regions}),
            texture=HOSTILE,
        ),
        splits=tuple(replace(s, label=HOSTILE, explanation=HOSTILE, phrase=HOSTILE) for s in reproduce_data.splits),
        networks=tuple(
            replace(n, label=HOSTILE, description=HOSTILE, trained_on=HOSTILE, step=HOSTILE)
            for n in reproduce_data.networks
        ),
        views=tuple(replace(v, title=HOSTILE, caption=HOSTILE) for v in reproduce_data.views),
        located=tuple(replace(f, name=HOSTILE) for f in reproduce_data.located),
        settings={HOSTILE: {HOSTILE: {HOSTILE: HOSTILE}}},
        stages=tuple(replace(s, name=HOSTILE, made=HOSTILE) for s in reproduce_data.stages),
        versions={HOSTILE: HOSTILE},
        machine={HOSTILE: HOSTILE},
        commit=HOSTILE,
    )
    made = page(hostile)
    tree = parsed(made)
    assert not list(tree.iter("script"))
    assert "<script" not in made
    assert "<img src=http" not in made
    assert all(image.get("src", "").startswith("data:") for image in tree.iter("img"))
    assert words(next(tree.iter("h1"))) == " ".join(HOSTILE.split())


def test_results_for_other_regions_are_refused(reproduce_data: ReportData) -> None:
    from naris.errors import InputError

    regions = SlabRegions("two", ("a", "b"), "mean", 1, (0.0,))
    anatomy = reproduce_data.anatomy.anatomy.with_(regions={"two": regions})
    with pytest.raises(InputError, match="confusion matrices"):
        replace(reproduce_data, anatomy=replace(reproduce_data.anatomy, anatomy=anatomy, region_set="two"))
    with pytest.raises(InputError, match="splits"):
        replace(reproduce_data, splits=reproduce_data.splits[:1])
