"""`naris train`, `evaluate`, `locate`: one small model goes through all three, and each refusal is one sentence."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from naris.anatomy.regions import write_regions
from naris.cli import main
from naris.core.camera import Intrinsics
from naris.dataset.read import Dataset
from naris.locate import locate
from naris.model.checkpoint import load_checkpoint
from tests.winding_tube import SLABS


@pytest.fixture(scope="module")
def pictures(tube: Path, tmp_path_factory) -> Path:
    """A data set of 48 pictures of the tube."""
    out = tmp_path_factory.mktemp("pictures") / "set"
    size = ["--width", "64", "--height", "64", "--no-depth", "--quiet"]
    assert main(["simulate", str(tube), "-o", str(out), "--count", "48", *size]) == 0
    return out


@pytest.fixture(scope="module")
def trained(pictures: Path, tmp_path_factory) -> Path:
    """The folder of a training of one epoch."""
    out = tmp_path_factory.mktemp("training") / "run"
    assert main(["train", str(pictures), "-o", str(out), "--epochs", "1", "--quiet"]) == 0
    return out


def test_training_tells_its_model_and_a_second_run_does_nothing(pictures: Path, trained: Path, capfd) -> None:
    model = trained / "model.safetensors"
    stamp = model.stat().st_mtime_ns
    assert main(["train", str(pictures), "-o", str(trained), "--epochs", "1", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert [run["model"] for run in told["runs"]] == [str(model)]
    assert told["runs"][0]["steps"] == 1
    assert model.stat().st_mtime_ns == stamp
    subject = load_checkpoint(model).subject
    assert subject.regions.names == ("one", "two", "three", "four")
    assert subject.anatomy_digest == Dataset.open(pictures).anatomy_digest


def test_another_training_in_the_same_folder_is_refused(pictures: Path, trained: Path, capfd) -> None:
    before = (trained / "model.safetensors").read_bytes()
    assert main(["train", str(pictures), "-o", str(trained), "--epochs", "2", "--quiet"]) == 2
    told = capfd.readouterr().err
    assert told.count("\n") == 1
    assert "got other settings: --epochs (1 → 2); use another folder" in told
    assert (trained / "model.safetensors").read_bytes() == before


@pytest.mark.long
def test_views_at_will_and_several_seeds(tube: Path, pictures: Path, tmp_path, capfd) -> None:
    assert main(["train", str(tube), "-o", str(tmp_path / "will"), "--steps", "2", "--scopes", "many", "--quiet"]) == 0
    assert load_checkpoint(tmp_path / "will" / "model.safetensors").network == "compact"
    words = ["--network", "two-layer", "--epochs", "1", "--seeds", "3", "5", "--workers", "2", "--json"]
    capfd.readouterr()
    assert main(["train", str(pictures), "-o", str(tmp_path / "two"), *words]) == 0
    told = json.loads(capfd.readouterr().out)
    assert [run["seed"] for run in told["runs"]] == [3, 5]
    assert main(["evaluate", str(tmp_path / "two"), "-d", str(pictures), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    (network,) = told["networks"]
    assert network["network"] == "two-layer"
    assert [one["seed"] for one in network["scores"]] == [3, 5]
    assert network["std"] is not None
    assert main(["locate", str(pictures / "images" / "000000.png"), "-m", str(tmp_path / "two")]) == 2
    assert "one model" in capfd.readouterr().err


def test_evaluation_counts_what_the_library_says(pictures: Path, trained: Path, tmp_path, capfd) -> None:
    out = tmp_path / "scores"
    assert main(["evaluate", str(trained), "-d", str(pictures), "-o", str(out), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    dataset = Dataset.open(pictures)
    answers = [one.region for one in locate(dataset.image_files, trained / "model.safetensors")]
    expected = np.zeros((4, 4), dtype=int)
    np.add.at(expected, (dataset.labels, answers), 1)
    (network,) = told["networks"]
    np.testing.assert_array_equal(network["scores"][0]["confusion"], expected)
    assert network["mean"] == pytest.approx(np.trace(expected) / 48)
    assert json.loads((out / "scores.json").read_text()) == told
    stamp = (out / "predictions-0.npz").stat().st_mtime_ns
    assert main(["evaluate", str(trained / "model.safetensors"), "-d", str(pictures), "-o", str(out)]) == 0
    assert (out / "predictions-0.npz").stat().st_mtime_ns == stamp
    assert f"accuracy {100 * network['mean']:.1f} %" in capfd.readouterr().out


def test_different_networks_stand_beside_each_other(pictures: Path, trained: Path, tmp_path, capfd) -> None:
    """Two networks are no two runs of one: each has figures and a matrix of its own, in the order they were named."""
    for seed in ("1", "2"):
        words = ["--network", "two-layer", "--epochs", "1", "--seeds", seed, "--quiet"]
        assert main(["train", str(pictures), "-o", str(tmp_path / seed), *words]) == 0
    models = [str(tmp_path / "1"), str(trained), str(tmp_path / "2")]
    capfd.readouterr()
    assert main(["evaluate", *models, "-d", str(pictures), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert [(one["network"], len(one["models"])) for one in told["networks"]] == [("two-layer", 2), ("compact", 1)]
    assert [one["std"] is None for one in told["networks"]] == [False, True]
    assert main(["evaluate", *models, "-d", str(pictures)]) == 0
    text = capfd.readouterr().out
    assert re.findall(r"^(compact|two-layer), ", text, re.MULTILINE) == ["two-layer", "compact"]
    assert text.count("true region by row") == 2


def test_scores_do_not_go_into_somebodys_folder(pictures: Path, trained: Path, tmp_path, capfd) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    assert main(["evaluate", str(trained), "-d", str(pictures), "-o", str(tmp_path)]) == 2
    assert "an evaluation, got other files" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_locating_says_what_the_library_says(pictures: Path, trained: Path, capfd) -> None:
    files = [str(pictures / "images" / f"{i:06d}.png") for i in range(3)]
    doubtless = ["--probability", "0", "--out-of-domain", "1"]
    assert main(["locate", *files, "-m", str(trained), *doubtless, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["model"]["regions"] == ["one", "two", "three", "four"]
    for one, said in zip(
        told["pictures"], locate([Path(f) for f in files], trained / "model.safetensors"), strict=True
    ):
        assert one["localised"] and one["why_not"] is None
        assert one["region"] == said.region_name
        assert sum(one["probabilities"].values()) == pytest.approx(1)
        np.testing.assert_allclose(one["hypotheses"][0]["anatomy_T_camera"], said.hypotheses.matrix[0], atol=1e-5)
        assert sum(h["weight"] for h in one["hypotheses"]) == pytest.approx(1, abs=1e-5)
        assert all(h["sd_mm"] > 0 and h["sd_deg"] > 0 for h in one["hypotheses"])


def test_nothing_localised_is_status_1_with_the_reason(pictures: Path, trained: Path, capfd) -> None:
    picture = str(pictures / "images" / "000000.png")
    assert main(["locate", picture, "-m", str(trained), "--probability", "1", "--out-of-domain", "1"]) == 1
    assert "not localised, no region is likely enough" in capfd.readouterr().out
    # A training of so few steps is not sure of its own pictures either: the region alone shall be the reason.
    assert main(["locate", picture, "-m", str(trained), "--probability", "1", "--out-of-domain", "1", "--json"]) == 1
    (told,) = json.loads(capfd.readouterr().out)["pictures"]
    assert (told["localised"], told["why_not"]) == (False, "no region is likely enough")


def test_the_camera_can_be_told(pictures: Path, trained: Path, tmp_path, capfd) -> None:
    picture = str(pictures / "images" / "000000.png")
    assert main(["locate", picture, "-m", str(trained), "--json"]) in (0, 1)
    plain = json.loads(capfd.readouterr().out)["pictures"][0]
    assert main(["locate", picture, "-m", str(trained), "--intrinsics", str(pictures / "dataset.json"), "--json"]) < 2
    same = json.loads(capfd.readouterr().out)["pictures"][0]
    assert same["probabilities"] == pytest.approx(plain["probabilities"], abs=0.05)
    (tmp_path / "camera.json").write_text('{"width": 64}')
    assert main(["locate", picture, "-m", str(trained), "--intrinsics", str(tmp_path / "camera.json")]) == 2
    assert capfd.readouterr().err.count("\n") == 1


def test_a_model_tells_a_registration_where_to_begin_unless_it_does_not_know_such_frames(
    tube: Path, pictures: Path, trained: Path, tmp_path, capfd, monkeypatch
) -> None:
    frame = next((pictures / "images").rglob("*.png"))
    np.save(tmp_path / "depth.npy", np.linspace(3, 9, 64 * 64).reshape(64, 64))
    camera = Intrinsics.from_vertical_fov(64, 64, 45.0)
    (tmp_path / "camera.json").write_text(json.dumps({k: v for k, v in asdict(camera).items() if v is not None}))
    seen = ["--depth", str(tmp_path / "depth.npy"), "--intrinsics", str(tmp_path / "camera.json"), "--quiet"]
    words = ["register", str(tube), *seen, "--frame", str(frame), "-m", str(trained / "model.safetensors")]
    told = {}
    for strange in (False, True):
        monkeypatch.setattr("naris.locate.is_strange", lambda prediction, strange=strange: strange)
        assert main([*words, "--json"]) in (0, 1)
        told[strange] = json.loads(capfd.readouterr().out)["model"]
    (prediction,) = locate([frame], trained / "model.safetensors")
    assert told[False]["region"] == told[True]["region"] == prediction.region_name
    assert told[False]["probability"] == pytest.approx(float(prediction.probabilities.max()), abs=1e-5)
    assert [told[strange]["used"] for strange in (False, True)] == [True, False]
    assert main(words) in (0, 1)
    assert "unlike all that the model has seen: what it says of it was not used" in capfd.readouterr().out


def test_the_folders_of_the_published_code_are_read_too(tube: Path, tmp_path, capfd) -> None:
    """Learned from and scored with regions that come from elsewhere, as their poses tell none."""
    words = ["--count", "12", "--no-depth", "--original", str(tmp_path / "published"), "--quiet"]
    assert main(["simulate", str(tube), "-o", str(tmp_path / "set"), *words]) == 0
    published = str(tmp_path / "published")
    short = ["--epochs", "1", "--quiet"]
    assert main(["train", published, "-o", str(tmp_path / "run"), *short]) == 2
    assert "give --regions paper for the published slabs, or a JSON file" in capfd.readouterr().err
    write_regions(SLABS, tmp_path / "slabs.json")
    named = ["--regions", str(tmp_path / "slabs.json")]
    assert main(["train", published, "-o", str(tmp_path / "run"), *short, *named]) == 0
    found = []
    assert main(["evaluate", str(tmp_path / "run"), "-d", str(tmp_path / "set"), *named]) == 2
    assert "--regions only with the published code's frame/ and pose/" in capfd.readouterr().err
    for data in ([published, *named], [str(tmp_path / "set")]):
        assert main(["evaluate", str(tmp_path / "run"), "-d", *data, "--json"]) == 0
        found.append(json.loads(capfd.readouterr().out)["networks"][0]["scores"][0]["confusion"])
    assert found[0] == found[1]
    (tmp_path / "published" / "pose" / "03.txt").unlink()
    assert main(["evaluate", str(tmp_path / "run"), "-d", published, *named]) == 2
    assert "got none for frame/03.png" in capfd.readouterr().err


def bad_words(kind: str, pictures: Path, trained: Path, folder: Path) -> list[str]:
    picture, model = pictures / "images" / "000000.png", trained / "model.safetensors"
    if kind == "a text file named png":
        (folder / "text.png").write_text("no picture")
        return ["locate", str(picture), str(folder / "text.png"), "-m", str(model)]
    if kind == "a picture that is not there":
        return ["locate", str(folder / "none.png"), "-m", str(model)]
    if kind == "a tiny picture":
        Image.new("RGB", (3, 3)).save(folder / "tiny.png")
        return ["locate", str(folder / "tiny.png"), "-m", str(model)]
    if kind == "a truncated model":
        (folder / "model.safetensors").write_bytes(model.read_bytes()[:-100])
        return ["locate", str(picture), "-m", str(folder / "model.safetensors")]
    if kind == "a picture as model":
        return ["locate", str(picture), "-m", str(picture)]
    if kind == "a folder without a model":
        return ["evaluate", str(folder), "-d", str(pictures)]
    if kind == "a data set without a picture":
        shutil.copytree(pictures, folder / "set")
        (folder / "set" / "images" / "000007.png").unlink()
        return ["evaluate", str(model), "-d", str(folder / "set")]
    if kind == "a data set without a pose":
        shutil.copytree(pictures, folder / "set")
        samples = folder / "set" / "samples.jsonl"
        rows = [json.loads(row) for row in samples.read_text().splitlines()]
        del rows[5]["anatomy_T_camera"]
        samples.write_text("".join(json.dumps(row) + "\n" for row in rows))
        return ["train", str(folder / "set"), "-o", str(folder / "run")]
    if kind == "other regions":
        main(["simulate", "--quiet", *_other_regions(pictures, folder)])
        return ["evaluate", str(model), "-d", str(folder / "other")]
    return {
        "two lengths": ["train", str(pictures), "-o", str(folder / "run"), "--epochs", "1", "--steps", "1"],
        "a seed twice": ["train", str(pictures), "-o", str(folder / "run"), "--seeds", "1", "1"],
        "looks of a data set": ["train", str(pictures), "-o", str(folder / "run"), "--appearance", "training"],
        "scopes of a data set": [
            "train",
            str(pictures),
            "-o",
            str(folder / "run"),
            "--scopes",
            "one",
            "--views",
            "anywhere",
        ],
        "field of view of a data set": ["train", str(pictures), "-o", str(folder / "run"), "--fov-deg", "45"],
        "regions of a data set": ["train", str(pictures), "-o", str(folder / "run"), "--regions", "slabs"],
        "runs at a time of one": ["train", str(pictures), "-o", str(folder / "run"), "--workers", "2"],
        "runs at a time on views": [
            "train",
            "builtin",
            "-o",
            str(folder / "run"),
            "--seeds",
            "1",
            "2",
            "--workers",
            "2",
        ],
        "nothing to learn from": ["train", str(folder / "none"), "-o", str(folder / "run")],
    }[kind]


def _other_regions(pictures: Path, folder: Path) -> list[str]:
    halves = {"schema": "naris.regions/1", "kind": "slabs", "name": "halves", "names": ["front", "back"]}
    (folder / "halves.json").write_text(json.dumps({**halves, "frame": "LPS", "axis": 1, "borders_mm": [0]}))
    tube = folder / "tube"
    from naris.anatomy.folder import save_anatomy
    from tests.winding_tube import winding_tube

    save_anatomy(winding_tube(), tube)
    size = ["--width", "64", "--height", "64", "--count", "4", "--no-depth"]
    return [str(tube), "-o", str(folder / "other"), "--regions", str(folder / "halves.json"), *size]


@pytest.mark.parametrize(
    "kind",
    [
        "a text file named png",
        "a picture that is not there",
        "a tiny picture",
        "a truncated model",
        "a picture as model",
        "a folder without a model",
        "a data set without a picture",
        "a data set without a pose",
        "other regions",
        "two lengths",
        "a seed twice",
        "looks of a data set",
        "scopes of a data set",
        "field of view of a data set",
        "regions of a data set",
        "runs at a time of one",
        "runs at a time on views",
        "nothing to learn from",
    ],
)
def test_a_refusal_is_one_sentence(kind: str, pictures: Path, trained: Path, tmp_path, capfd) -> None:
    words = bad_words(kind, pictures, trained, tmp_path)
    capfd.readouterr()
    assert main([*words, "--quiet"]) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert re.fullmatch(r"naris: [^\n]+; [^\n]+\n", told.err), told.err
    assert not (tmp_path / "run" / "model.safetensors").exists()


@pytest.mark.parametrize(
    ("source", "got"),
    [("nope/", "nothing at nope/"), (".", "the folder . with neither"), ("notes.txt", "the file notes.txt")],
)
def test_where_there_is_nothing_to_learn_from_both_kinds_are_told(
    source: str, got: str, tmp_path, monkeypatch, capfd
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("about noses")
    assert main(["train", source, "-o", "run"]) == 2
    told = capfd.readouterr().err
    for word in (
        "a data set (a folder with dataset.json",
        "builtin",
        ".stl",
        "a folder with anatomy.json",
        f"got {got};",
    ):
        assert word in told
    assert not (tmp_path / "run").exists()


def test_where_there_is_no_data_set_to_evaluate_on(tube: Path, trained: Path, capfd) -> None:
    for folder, got in ((tube / "nope", "nothing"), (tube, "a folder without dataset.json")):
        assert main(["evaluate", str(trained), "-d", str(folder)]) == 2
        told = capfd.readouterr().err
        assert re.fullmatch(
            rf"naris: expected a data set \(.*naris simulate\) at .*, got {got}; check the path\n", told
        ), told


@pytest.mark.slow
def test_other_views_of_an_anatomy_are_refused_by_name(tube: Path, tmp_path, capfd) -> None:
    words = ["train", str(tube), "-o", str(tmp_path / "run"), "--steps", "1", "--quiet"]
    assert main(words) == 0
    capfd.readouterr()
    assert main([*words, "--views", "travel", "--fov-deg", "60", "--appearance", "unseen"]) == 2
    told = capfd.readouterr().err
    assert "got other data: --views (inspection → travel), --appearance, --fov-deg (45 → 60); use another" in told
    assert main([*words, "--seeds", "3"]) == 2
    assert "got other settings: --seeds (0 → 3)" in capfd.readouterr().err
