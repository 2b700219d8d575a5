"""Restarts: numbers are never given twice, the network comes back whole or not at all."""

from pathlib import Path

import pytest

from calib.station.archive.state_store import StateStore
from tools.doubles.flight import Spec, make

CAMERAS = {f"cam{k}" for k in range(6)}


def test_every_start_has_its_own_epoch_and_track_numbers(tmp_path: Path) -> None:
    first = StateStore(tmp_path).load(CAMERAS)
    second = StateStore(tmp_path).load(CAMERAS)
    assert (first.epoch, second.epoch) == (1, 2)
    assert second.first_track > first.first_track


def test_numbers_used_in_a_run_that_was_killed_are_not_given_again(tmp_path: Path) -> None:
    with StateStore(tmp_path) as keeper:
        keeper.load(CAMERAS)
        for track in range(1, 500):
            keeper.note(track, 0)
    assert StateStore(tmp_path).load(CAMERAS).first_track > 499


def test_the_network_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    network = make(Spec()).network
    with StateStore(tmp_path) as keeper:
        keeper.store_network(network)
    stored = StateStore(tmp_path).load(CAMERAS).network
    assert stored is not None
    assert stored.fingerprint == network.fingerprint


@pytest.mark.parametrize("damage", ["edit", "cut", "strangers"])
def test_a_network_that_is_not_what_was_stored_is_not_believed(tmp_path: Path, damage: str) -> None:
    with StateStore(tmp_path) as keeper:
        keeper.store_network(make(Spec()).network)
    path = tmp_path / "network.toml"
    text = path.read_text()
    if damage == "edit":
        path.write_text(text.replace("rms_px = 1.0", "rms_px = 1.1"))
    elif damage == "cut":
        path.write_text(text[: len(text) // 2])
    cameras = {"cam0"} if damage == "strangers" else CAMERAS
    assert StateStore(tmp_path).load(cameras).network is None


def test_a_disk_that_cannot_be_written_is_a_fault_not_an_exception(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    keeper = StateStore(tmp_path / "file")
    assert keeper.load(CAMERAS).epoch == 1
    assert "cannot be written" in keeper.fault
