"""A training in the folder of another is refused, and told by name what differs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from naris.core.provenance import plain
from naris.dataset.layout import RegionLabels
from naris.errors import ConfigurationChanged
from naris.model.two_layer import TwoLayerConfig
from naris.train import COMPACT_FEW, Examples, TrainConfig, loop, train
from naris.train.loop import RUN, STATE, by_other_code
from tests.train.test_runs import SHORT, SLABS, examples


class Stop:
    """Progress that ends a training after its first step as Ctrl-C does."""

    def task(self, name: str, total: int) -> Stop:
        return self

    def __enter__(self) -> object:
        return self.advance

    def advance(self, steps: int) -> None:
        if steps:
            raise KeyboardInterrupt

    def __exit__(self, *error: object) -> None:
        pass


def other_anatomy() -> Examples:
    same = examples()
    return replace(same, subject=replace(same.subject, anatomy_digest="1" * 64))


def other_regions() -> Examples:
    same = examples()
    regions = RegionLabels.of(replace(SLABS, borders_mm=(-9.0, 10.0)))
    return replace(same, subject=replace(same.subject, regions=regions))


def other_pictures() -> Examples:
    same = examples()
    return replace(same, images=255 - same.images)


REFUSED = [
    (examples(), SHORT.with_(seed=4), r"got other settings: --seeds \(0 → 4\);"),
    (examples(), SHORT.lasting(budget_s=2.5), r"settings: --epochs \(1 → none\), --budget-s \(none → 2.5\);"),
    (examples(), SHORT.with_(batch=12), r"got other settings: batch \(8 → 12\);"),
    (
        examples(),
        COMPACT_FEW.with_(seed=1),
        r"--network \(two-layer → compact\), --epochs \(1 → 60\), --seeds \(0 → 1\);",
    ),
    (other_pictures(), SHORT, "got other data: the pictures;"),
    (other_anatomy(), SHORT, "got other data: the anatomy, the pictures;"),
    (other_regions(), SHORT, "got other data: the region set, the pictures;"),
    (other_pictures(), SHORT.with_(seed=4), r"other settings: --seeds \(0 → 4\) and other data: the pictures;"),
]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    train(examples(), SHORT, folder)
    return folder


@pytest.mark.parametrize(("data", "config", "told"), REFUSED)
def test_what_differs_from_a_finished_training_is_named(
    finished: Path, data: Examples, config: TrainConfig, told: str
) -> None:
    with pytest.raises(ConfigurationChanged, match=told):
        train(data, config, finished)


@pytest.mark.parametrize(("data", "config", "told"), REFUSED)
def test_what_differs_from_a_training_that_was_stopped_is_named(
    tmp_path: Path, data: Examples, config: TrainConfig, told: str
) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(examples(), SHORT.with_(state_every_s=0.0), tmp_path, progress=Stop())
    assert (tmp_path / STATE).is_file()
    with pytest.raises(ConfigurationChanged, match=told):
        train(data, config, tmp_path)


def test_settings_that_only_say_how_the_work_is_done_are_no_difference(finished: Path) -> None:
    elsewhere = SHORT.with_(threads=3, state_every_s=7.0)
    assert train(examples(), elsewhere, finished).steps == 3
    with pytest.raises(ConfigurationChanged, match=r"got other settings: batch \(8 → 12\);"):
        train(examples(), elsewhere.with_(batch=12), finished)


def test_records_of_older_versions_tell_what_they_hold(tmp_path: Path) -> None:
    train(examples(), SHORT, tmp_path)
    record = json.loads((tmp_path / RUN).read_text())
    assert record["settings"] == plain(SHORT)
    del record["data"]
    (tmp_path / RUN).write_text(json.dumps(record))
    assert train(examples(), SHORT, tmp_path).steps == 3
    with pytest.raises(ConfigurationChanged, match="got others;"):
        train(other_pictures(), SHORT, tmp_path)
    with pytest.raises(ConfigurationChanged, match=r"got other settings: network input px \(24 → 28\);"):
        train(examples(), SHORT.with_(network=TwoLayerConfig(28)), tmp_path)


def test_which_code_made_a_training_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one that another code went on with, both; code with changes that no commit has is never the same."""
    here = ["first"]
    monkeypatch.setattr(loop, "commit", lambda: here[0])
    with pytest.raises(KeyboardInterrupt):
        train(examples(), SHORT.with_(state_every_s=0.0), tmp_path / "stopped", progress=Stop())
    train(examples(), SHORT, tmp_path / "whole")
    assert by_other_code(tmp_path / "whole") is None
    here[0] = "second"
    assert by_other_code(tmp_path / "whole") == "first"
    train(examples(), SHORT.with_(state_every_s=0.0), tmp_path / "stopped")
    assert by_other_code(tmp_path / "stopped") == "first, then second"
    here[0] = "first-dirty"
    train(examples(), SHORT, tmp_path / "changed")
    assert by_other_code(tmp_path / "changed") == "first-dirty"
