"""Model files: round trips, whole files only, and readable refusals."""

from __future__ import annotations

import json

import numpy as np
import pytest
from safetensors.numpy import save_file

from bdnn_ros.bdnn import modelfile
from bdnn_ros.errors import ModelFileError
from bdnn_ros.models import load_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

ARRAYS = {
    "weights": np.random.default_rng(0).normal(size=(3, 4)).astype(np.float32),
    "scale": np.array([1e-300, np.pi, -0.0]),
    "transposed": np.arange(6.0).reshape(2, 3).T,
    "empty": np.zeros((0, 2)),
}
INFO = {"joints": ["a", "ä"], "nested": {"x": [1, 2.5, None, True]}}


def test_what_is_saved_is_loaded(tmp_path):
    path = modelfile.save(tmp_path / "out", "bdnn", ARRAYS, INFO)
    assert path == tmp_path / "out" / "model.bdnn"
    for place in (path, path.parent):
        kind, arrays, info = modelfile.load(place)
        assert (kind, info) == ("bdnn", INFO)
        assert arrays.keys() == ARRAYS.keys()
        for key, value in ARRAYS.items():
            np.testing.assert_array_equal(arrays[key], value)
            assert arrays[key].dtype == value.dtype


def test_a_file_may_have_any_name(tmp_path):
    path = modelfile.save(tmp_path / "panda.bdnn", "physical", ARRAYS, {})
    assert path.name == "panda.bdnn"
    assert modelfile.load(path)[0] == "physical"


@pytest.mark.parametrize("name", ["run_2026.11.26", "rep.v1", "model.safetensors"])
def test_only_its_own_suffix_means_a_file(tmp_path, name):
    path = modelfile.save(tmp_path / name, "bdnn", ARRAYS, INFO)
    assert path == tmp_path / name / "model.bdnn"
    (tmp_path / "folder.bdnn").mkdir()
    assert modelfile.save(tmp_path / "folder.bdnn", "bdnn", {}, {}).name == "model.bdnn"


def test_an_interrupted_save_leaves_the_old_model_and_no_litter(tmp_path, monkeypatch):
    path = modelfile.save(tmp_path, "bdnn", ARRAYS, INFO)

    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(modelfile.os, "replace", fail)
    with pytest.raises(KeyboardInterrupt):
        modelfile.save(tmp_path, "bdnn", {}, {"other": 1})
    assert modelfile.load(path)[2] == INFO
    assert [p.name for p in tmp_path.iterdir()] == ["model.bdnn"]


def test_missing_damaged_and_foreign_files_are_refused(tmp_path):
    path = modelfile.save(tmp_path / "good", "bdnn", ARRAYS, INFO)
    with pytest.raises(ModelFileError, match="no model at"):
        modelfile.load(tmp_path)
    for name, content in {"cut": path.read_bytes()[:50], "text": b"hello", "none": b""}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ModelFileError, match="damaged"):
            modelfile.load(tmp_path / name)
    save_file({"x": np.zeros(1)}, tmp_path / "foreign")
    with pytest.raises(ModelFileError, match="not a model of bdnn_ros"):
        modelfile.load(tmp_path / "foreign")
    save_file({"x": np.zeros(1)}, tmp_path / "deep", {"bdnn_ros": "[" * 100_000})
    with pytest.raises(ModelFileError, match="damaged"):
        modelfile.load(tmp_path / "deep")


@pytest.mark.parametrize(("name", "value"), [("covariance", np.nan), ("noise", np.inf)])
def test_values_that_are_no_numbers_are_refused(tmp_path, name, value):
    """They were loaded, and all that such a model said was NaN."""
    robot = Robot.bundled("arm2")
    none = np.zeros(2)
    model = PhysicalModel(robot, offset=none, covariance=np.eye(28), noise=none + 0.1)
    arrays, info = model.to_state()
    assert load_model(modelfile.save(tmp_path, model.kind, arrays, info)).joints == robot.joints
    damaged = arrays[name].copy()
    damaged.flat[1] = value
    path = modelfile.save(tmp_path, model.kind, {**arrays, name: damaged}, info)
    with pytest.raises(
        ModelFileError, match=f"is damaged: its array {name} holds values that are no numbers"
    ):
        load_model(path)
    assert modelfile.load(path, finite=False)[0] == "physical"


def test_whatever_is_altered_in_a_file_is_told(tmp_path):
    """A model of which one number was another was taken, and a diagnosis against it named what nothing had."""
    path = modelfile.save(tmp_path, "bdnn", ARRAYS, INFO)
    written = path.read_bytes()
    start = 8 + int.from_bytes(written[:8], "little")
    for at in (*range(start, len(written), 7), written.index(b"2.5", 8), written.index(b"sha256", 8) + 12):
        path.write_bytes(written[:at] + bytes([written[at] ^ 1]) + written[at + 1 :])
        with pytest.raises(ModelFileError, match=rf"^{path} is damaged") as refused:
            modelfile.load(path, finite=False)
        assert refused.value.remedy
    path.write_bytes(written)
    assert modelfile.load(path)[2] == INFO


def test_files_of_before_have_no_checksum(tmp_path):
    header = {"format": modelfile.FORMAT, "version": modelfile.VERSION, "kind": "bdnn", "info": INFO}
    save_file(ARRAYS, tmp_path / "before", metadata={"bdnn_ros": json.dumps(header)})
    assert modelfile.load(tmp_path / "before")[2] == INFO


def test_a_damaged_description_names_the_file(tmp_path):
    robot = Robot.bundled("arm2")
    model = PhysicalModel(robot, np.zeros(2), np.eye(28), np.full(2, 0.1))
    arrays, info = model.to_state()
    path = modelfile.save(
        tmp_path, model.kind, arrays, {**info, "urdf": info["urdf"].replace("<link", "<lin", 1)}
    )
    with pytest.raises(
        ModelFileError, match=rf"^{path}: The physical model is damaged: .* Identify it again\.$"
    ):
        load_model(path)


def test_another_version_is_named(tmp_path):
    header = json.dumps({"format": modelfile.FORMAT, "version": 99, "kind": "bdnn", "info": {}})
    save_file({"x": np.zeros(1)}, tmp_path / "later", metadata={"bdnn_ros": header})
    with pytest.raises(ModelFileError, match="version 99"):
        modelfile.load(tmp_path / "later")


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ModelFileError, match="cannot be written"):
        modelfile.save(tmp_path / "file" / "model.bdnn", "bdnn", ARRAYS, {})
