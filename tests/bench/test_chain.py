"""The chain, frame in and pose out: its figures are of all frames, and a broken one goes on where it was."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.bench import BenchRequest, chain, chain_patient
from naris.bench.chain import VIRTUAL, chosen, figures, inputs, lost
from naris.bench.chain_patient import BELIEFS, CHAIN_NOISES, ChainConfig, Patient, beliefs, measured
from naris.bench.chain_record import Fit, FrameRecord, Outcome, PatientRecord, read_record, write_record
from naris.bench.result import Figure
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose
from naris.core.progress import SILENT
from naris.core.results import Prediction
from naris.errors import ConfigurationChanged, InputError
from naris.register.libraries import LIBRARIES, missing
from tests.winding_tube import SLABS, winding_tube

RIGHT, REFUSED = Outcome(0.5, 3.0, True, 0.4), Outcome(0.5, 3.0, False, 0.4)
WRONG, LOST = Outcome(9.0, 30.0, True, 0.4), Outcome(9.0, 30.0, False, 0.4)
TINY = ChainConfig(fit_steps=2, two_layer_steps=1, views=2)


def frame(given: Outcome, others: Mapping[str, Outcome] | None = None, said: str = "one") -> FrameRecord:
    """One whose registrations are right, but for that of the prediction and some others."""
    of_noise = dict.fromkeys(BELIEFS, RIGHT) | {"prediction": given} | dict(others or {})
    networks = {"compact": said, "two_layer": "two"}
    by_others = {"b": {"Open3D": LOST}, "c": {}}
    return FrameRecord("one", networks, 2.0, 5.0, dict.fromkeys(CHAIN_NOISES, of_noise), by_others, "abc")


def patient(*frames: FrameRecord, real: bool = False) -> PatientRecord:
    return PatientRecord("virtual-00", "a nose, digest", real, Fit(100.0, 150.0, 64), frames)


def by_name(made: list[Figure]) -> dict[str, Figure]:
    named = {figure.name: figure for figure in made}
    assert len(named) == len(made)
    return named


def test_shares_are_of_all_frames_and_a_refusal_is_a_failure() -> None:
    made = by_name(figures([patient(frame(RIGHT), frame(REFUSED), frame(WRONG), frame(LOST, said="two"))]))
    base = "register.chain.b"
    assert made[f"{base}.tre_lt2"].value == made[f"{base}.tre_lt1"].value == 0.25
    assert made[f"{base}.landmarks_lt2"].value == 0
    assert made[f"{base}.refused"].value == 0.5
    assert made[f"{base}.accepted_wrong"].value == 0.25
    assert made[f"{base}.likeliest_lt2"].value == 0.5
    assert made[f"{base}.true.tre_lt2"].value == 1
    assert made["register.chain.compact.region_accuracy"].value == 0.75
    assert made["register.chain.two_layer.region_accuracy"].value == 0
    assert made[f"{base}.by_open3d.tre_lt2"].value == 0
    assert all(figure.n == 4 for name, figure in made.items() if ".b." in name and figure.value is not None)
    assert made["register.chain.c.by_open3d.tre_lt2"].value is None


def test_right_refused_and_wrong_are_all_there_is_and_every_loss_has_a_reason() -> None:
    outcomes = (RIGHT, RIGHT, REFUSED, WRONG, LOST)
    made = by_name(figures([patient(*map(frame, outcomes))]))
    for noise in CHAIN_NOISES:
        parts = [
            made[f"register.chain.{noise}.{part}"].value or 0.0 for part in ("tre_lt2", "refused", "accepted_wrong")
        ]
        assert sum(parts) == pytest.approx(1)
        reasons = [made[f"register.chain.{noise}.lost.{reason}"].value or 0.0 for reason in chain.LOST]
        assert sum(reasons) == pytest.approx(1 - parts[0])


@pytest.mark.parametrize(
    ("given", "others", "why"),
    [
        (RIGHT, {}, None),
        (REFUSED, {"truth": WRONG}, "doubt"),
        (WRONG, {"truth": WRONG}, "depth"),
        (LOST, {"truth": REFUSED}, "belief"),
        (WRONG, {"true": WRONG}, "search"),
    ],
)
def test_a_loss_is_told_by_what_would_have_been_right(given: Outcome, others: dict, why: str | None) -> None:
    assert lost(frame(given, others).found["b"]) == why


def test_fewer_patients_are_told_and_miss_the_goal() -> None:
    records = [patient(frame(RIGHT)), replace(patient(frame(WRONG), real=True), key="p001")]
    made, told = by_name(figures(records)), inputs(records, BenchRequest())
    assert made["register.chain.patients"].value == 2
    assert not made["register.chain.patients"].reached
    assert told["patients"] == f"1 of {VIRTUAL} virtual patients, 1 of 2 real scans"
    assert told["p001, measured by"] == "abc"
    assert made["register.chain.scans.b.tre_lt2"].value == 0
    assert made["register.chain.virtual.b.tre_lt2"].value == 1


def test_patients_are_as_many_as_asked_for_and_scans_come_first(tmp_path: Path) -> None:
    assert len(chosen(BenchRequest(quick=True))) == 1
    assert len(chosen(BenchRequest())) == VIRTUAL
    assert len(chosen(BenchRequest(patients=3, scans=tmp_path))) == 3
    (tmp_path / chain.HEAD).parent.mkdir()
    (tmp_path / chain.HEAD).touch()
    keys = [one.key for one in chosen(BenchRequest(patients=2, scans=tmp_path))]
    assert keys == ["ct-head", "virtual-00", "virtual-01"]


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    record = patient(frame(RIGHT), frame(replace(WRONG, landmarks_mm=None)))
    write_record(record, tmp_path / "frames.json")
    assert read_record(tmp_path / "frames.json") == record
    assert read_record(tmp_path / "none.json") is None


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "other"}', '{"schema": "naris.chain/3", "frames": [1]}'])
def test_another_file_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "frames.json").write_text(text)
    with pytest.raises(InputError, match="remove that file"):
        read_record(tmp_path / "frames.json")


def test_beliefs_tell_as_much_as_their_names_say() -> None:
    truth = Pose.look(np.array([0.0, -5.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), "LPS")
    shares = np.array([0.1, 0.2, 0.3, 0.4])
    said = Prediction("slabs", SLABS.names, np.log(shares), truth.reshape(1), np.ones(1), np.eye(6)[None])
    found = beliefs(SLABS, {"compact": said, "two_layer": replace(said, log_probabilities=np.log(shares[::-1]))}, truth)
    assert tuple(found) == BELIEFS
    assert found["prediction"].poses is not None
    assert found["regions"].poses is None
    assert found["regions"].chances == found["prediction"].chances
    assert found["hard"].chances == {"four": 1.0}
    assert found["true"].chances == {"two": 1.0}
    assert found["none"].regions is None
    assert max(found["two_layer"].chances, key=found["two_layer"].chances.get) == "one"
    assert found["truth"].only_poses
    assert found["truth"].poses.source == CAMERA


@pytest.mark.long
def test_a_patient_that_was_broken_off_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    whole = chain_patient.of_frame

    def breaks(*arguments: object) -> FrameRecord:
        made.append(1)
        if len(made) == 3:  # the first one only warms up
            raise KeyboardInterrupt
        return whole(*arguments)

    monkeypatch.setattr(Patient, "anatomy", lambda self, seed: winding_tube())
    monkeypatch.setattr(chain_patient, "of_frame", breaks)
    tube = Patient("tube", 0)
    with pytest.raises(KeyboardInterrupt):
        measured(tube, TINY, tmp_path / "tube", SILENT)
    first = read_record(tmp_path / "tube" / "frames.json")
    assert first is not None
    assert len(first.frames) == 1

    monkeypatch.setattr(chain_patient, "train", _finished(chain_patient.train))
    done = measured(tube, TINY, tmp_path / "tube", SILENT)
    assert len(done.frames) == 2
    assert done.frames[0] == first.frames[0]
    assert set(done.frames[0].found) == set(CHAIN_NOISES)
    assert set(done.frames[0].found["c"]) == set(BELIEFS)
    assert set(done.frames[0].by_others["b"]) == {"naris", *(name for name in LIBRARIES if missing(name) is None)}
    shutil.rmtree(tmp_path / "tube" / "compact")
    assert chain_patient.is_learned(tube, TINY, tmp_path / "tube")
    assert not chain_patient.is_learned(tube, replace(TINY, views=3), tmp_path / "tube")
    monkeypatch.setattr(Patient, "anatomy", _not_again)
    assert measured(tube, TINY, tmp_path / "tube", SILENT) == done


def test_a_folder_of_other_settings_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chain, "measured", lambda *arguments: patient(frame(RIGHT)))
    monkeypatch.setattr(chain, "is_learned", lambda *arguments: True)
    chain.measure(BenchRequest(patients=1, work=tmp_path))
    chain.measure(BenchRequest(patients=2, work=tmp_path))
    with pytest.raises(ConfigurationChanged, match=r"--fit-steps \(3000 → 9\), --seed \(0 → 1\)"):
        chain.measure(BenchRequest(patients=2, seed=1, fit_steps=9, work=tmp_path))
    assert json.loads((tmp_path / "settings.json").read_text())["settings"]["experiment"] == "chain"


@pytest.mark.long
def test_networks_of_several_patients_are_there_before_the_first_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[list[bool]] = []

    def looks(*arguments: object) -> PatientRecord:
        found.append([(tmp_path / f"virtual-0{number}" / "compact" / "run.json").is_file() for number in (0, 1)])
        return patient(frame(RIGHT))

    monkeypatch.setattr(chain, "VIRTUAL", 2)
    monkeypatch.setattr(chain, "ChainConfig", lambda: TINY)
    monkeypatch.setattr(chain, "measured", looks)
    chain.measure(BenchRequest(work=tmp_path))
    assert found == [[True, True]] * 2


def _finished(train):
    """A training that must find its folder finished."""

    def again(data, config, out, **options):
        assert (out / "run.json").is_file()
        return train(data, config, out, **options)

    return again


def _not_again(self: Patient, seed: int) -> Anatomy:
    raise AssertionError
