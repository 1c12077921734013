"""Both files are read, and whatever is not as it should be is told in one line."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from human_data import BLOCKS, DATA, PEOPLE, TRIALS, made_up_table, needs_people, write_made_up

from papers.human.reading import STYLES, read_people, read_speeds
from whiptool.errors import InputError


def test_made_up_throws_are_read(tmp_path):
    people = read_people(write_made_up(tmp_path / "data"))
    assert len(people.throws) == 2 * PEOPLE * BLOCKS * TRIALS
    assert set(people.throws["style"]) == set(STYLES)
    assert people.throws["duration"].between(0.35, 0.7).all()
    assert len(people.speeds) == 2 * PEOPLE
    one = people.of_style("discrete")[0]
    assert one.markers.shape == (11, 200)
    np.testing.assert_allclose(one.peaks[[0, -1]], [29.1, 5.1], rtol=1e-3)
    np.testing.assert_allclose(one.peak_times[[0, -1]], [0.55 / 0.6, 0.5], atol=0.01)
    assert people.shapes["rhythmic"].shape == (PEOPLE * BLOCKS * TRIALS, 3, 12)


@needs_people
def test_their_counts():
    people = read_people(DATA)
    assert len(people.throws) == 5227
    assert people.throws.groupby("style").size().to_dict() == {"discrete": 2665, "rhythmic": 2562}
    assert people.throws["person"].nunique() == 16
    assert len(people.speeds) == 32


def refused(folder, *words):
    with pytest.raises(InputError) as error:
        read_people(folder)
    said = str(error.value)
    assert "\n" not in said
    assert all(word in said for word in words), said


def test_a_missing_column(tmp_path):
    write_made_up(tmp_path)
    made_up_table().drop(columns=["MinDist", "HitFlag"]).to_csv(tmp_path / "trial_stats.csv", index=False)
    refused(tmp_path, "MinDist, HitFlag")


@pytest.mark.parametrize(
    ("column", "value"), [("StyleDR", 3), ("MinDist", -0.1), ("HitFlag", 0.5), ("MinDist", np.nan), ("t_MinDist", 0.1)]
)
def test_a_value_out_of_range(tmp_path, column, value):
    table = made_up_table()
    table[column] = table[column].astype(float)
    table.loc[7, column] = value
    write_made_up(tmp_path)
    table.to_csv(tmp_path / "trial_stats.csv", index=False)
    refused(tmp_path, column, *(["row 9"] if column != "t_MinDist" else []))


def test_an_angle_may_be_missing(tmp_path):
    table = made_up_table()
    table.loc[3, "HandAzAng_PeakHand"] = np.nan
    assert read_people(write_made_up(tmp_path, table)).throws["hand_azimuth"].isna().sum() == 1


def test_no_folder_and_no_files(tmp_path):
    refused(tmp_path / "nowhere", "folder")
    refused(tmp_path, "trial_stats.csv", "WhipTask_TrialStats.csv")


def test_what_is_no_table_and_no_matlab_file(tmp_path):
    write_made_up(tmp_path)
    good = (tmp_path / "trial_stats.csv").read_bytes()
    for bad in (b"", b"\x89PNG\r\n\x1a\n\xff\xfe\x00", b"a,b\n1,2\n"):
        (tmp_path / "trial_stats.csv").write_bytes(bad)
        refused(tmp_path, "trial_stats.csv")
    (tmp_path / "trial_stats.csv").write_bytes(good)
    (tmp_path / "whip_task_data.mat").write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(600, b"\0"))
    refused(tmp_path, "whip_task_data.mat", "v7.3")


def test_a_damaged_matlab_file_is_read_or_refused(tmp_path):
    write_made_up(tmp_path)
    path, rng = tmp_path / "whip_task_data.mat", np.random.default_rng(3)
    whole = path.read_bytes()
    for _ in range(40):
        content = bytearray(whole)
        for at in rng.integers(len(content), size=20):
            content[at] = rng.integers(256)
        path.write_bytes(content[: rng.integers(len(content) // 2, 2 * len(content))])
        with suppress(InputError):
            read_speeds(path)


def test_another_version_of_the_structure(tmp_path):
    import h5py

    write_made_up(tmp_path)
    with h5py.File(tmp_path / "whip_task_data.mat", "r+") as file:
        del file["WhipTask_TimeSeries"]["WSmean"]
    refused(tmp_path, "WSmean")
    with h5py.File(tmp_path / "whip_task_data.mat", "r+") as file:
        file["WhipTask_TimeSeries"]["WSmean"] = np.zeros((10, 1))
    refused(tmp_path, "WSmean", "another way")
    with h5py.File(tmp_path / "whip_task_data.mat", "w") as file:
        file["WhipTask_TimeSeries"] = np.zeros((10, 1))
    refused(tmp_path, "WhipTask_TimeSeries")
    with h5py.File(tmp_path / "whip_task_data.mat", "w") as file:
        file["other"] = 1
    refused(tmp_path, "WhipTask_TimeSeries")


def test_files_of_other_throws(tmp_path):
    write_made_up(tmp_path)
    made_up_table().iloc[1:].to_csv(tmp_path / "trial_stats.csv", index=False)
    refused(tmp_path, "80 discrete throws", "79")
    table = made_up_table()
    table["MinDist"] += 0.001
    table.to_csv(tmp_path / "trial_stats.csv", index=False)
    refused(tmp_path, "other distances")
