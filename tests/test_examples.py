"""Every example runs, and leaves what it says."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
WRITTEN = {
    "00_one_view": ((), "view.png"),
    "01_a_surface_of_your_own": ((), "anatomy/anatomy.json"),
    "02_a_data_set": ((8,), "original/pose"),
    "03_train_and_locate": ((2.0,), "model/model.safetensors"),
    "04_register": ((), "overlay.png"),
}


def test_none_is_left_out() -> None:
    assert sorted(WRITTEN) == sorted(path.stem for path in EXAMPLES.glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITTEN)
def test_example(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("naris.train.fit._KEPT_PICTURES", 64)  # to calibrate with, after two seconds of training
    arguments, written = WRITTEN[name]
    main = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    main(tmp_path, *arguments)
    assert (tmp_path / written).exists()
    said = capsys.readouterr().out
    assert said.count("\n") >= 3
    assert "refused" in said or "surface" not in name
    if name == "04_register":
        assert "built-in nose: registered" in said and "of seed 7: refused" in said
    if name == "02_a_data_set":  # which says that the same call goes on where it was
        main(tmp_path, *arguments)
