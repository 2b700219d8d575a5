"""Restarts: numbers are never given twice, the network comes back whole or not at all."""

import hashlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.network import to_toml
from calib.station.archive.state_store import TICKS_ASIDE, StateStore
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


def test_a_signing_time_that_was_taken_back_by_years_is_stored_and_one_of_a_killed_start_is_not(tmp_path: Path) -> None:
    year = 365 * 86_400 * 100_000
    with StateStore(tmp_path) as keeper:
        keeper.load(CAMERAS)
        for ticks in (20 * year, 10 * year, 10 * year - 50 * TICKS_ASIDE, 0):
            keeper.note(1, ticks)
    stored = StateStore(tmp_path).load(CAMERAS).signing_ticks
    assert stored == 10 * year + TICKS_ASIDE


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


# What another version may have done to a file: keys that this one does not know, anywhere, and those it writes but the
# other did not. The mark is of the text as that version wrote it.
OTHER_VERSIONS = {
    "a key at the top": lambda text: f"future_key = 1\n{text}",
    "a key of the network": lambda text: text.replace("[network]\n", '[network]\nrefraction = "standard"\n'),
    "a key of each camera": lambda text: text.replace("[[camera]]\n", "[[camera]]\ntilt = 0.5\n"),
    "a table of its own": lambda text: f"{text}\n[weather]\nkelvin = 280.0\n",
    "a key that it did not write": lambda text: "".join(
        line for line in text.splitlines(keepends=True) if not line.startswith("correlated_s")
    ),
    "other spelling": lambda text: text.replace(" = ", "="),
}


@pytest.mark.parametrize("change", OTHER_VERSIONS.values(), ids=OTHER_VERSIONS)
def test_another_versions_network_is_used(tmp_path: Path, change: Callable[[str], str]) -> None:
    network = make(Spec()).network
    text = change(to_toml(network))
    mark = hashlib.sha256(text.encode()).hexdigest()[:12]
    (tmp_path / "network.toml").write_text(f"# fingerprint {mark}\n{text}")
    assert StateStore(tmp_path).load(CAMERAS).network is not None


@pytest.mark.parametrize("line", ["future_key = 1", "# a remark", ""])
def test_a_line_put_above_the_mark_costs_no_calibration(tmp_path: Path, line: str) -> None:
    with StateStore(tmp_path) as keeper:
        keeper.store_network(make(Spec()).network)
    path = tmp_path / "network.toml"
    path.write_text(f"{line}\n{path.read_text()}")
    assert StateStore(tmp_path).load(CAMERAS).network is not None


def test_a_network_that_is_not_used_is_set_aside(tmp_path: Path) -> None:
    """A later version's format, say: after the step forward again it is there."""
    with StateStore(tmp_path) as keeper:
        keeper.store_network(make(Spec()).network)
    path = tmp_path / "network.toml"
    later = path.read_text().replace("format = ", "format = 1")
    path.write_text(later)
    assert StateStore(tmp_path).load(CAMERAS).network is None
    assert not path.exists()
    assert (tmp_path / "network.toml.aside").read_text() == later


@given(st.dictionaries(st.text(max_size=10), st.integers() | st.text(max_size=5), max_size=3))
def test_a_later_versions_counters_go_on_and_keep_what_is_not_known(others: dict[str, object]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "counters.json"
        file.write_text(json.dumps(others | {"epoch": 5, "next_track": 700, "signing_ticks": 7}))
        state = StateStore(Path(folder)).load(CAMERAS)
        assert (state.epoch, state.first_track, state.signing_ticks) == (6, 700, 7)
        kept = json.loads(file.read_text())
        assert {name: kept[name] for name in others if name not in ("epoch", "next_track", "signing_ticks")} == {
            name: value for name, value in others.items() if name not in ("epoch", "next_track", "signing_ticks")
        }


@pytest.mark.parametrize("garbage", [b"", b'{"x', b"\x00" * 40, b'{"epoch": "five"}', b"[]"])
def test_after_a_damaged_file_no_number_is_given_twice(tmp_path: Path, garbage: bytes) -> None:
    used = 0
    for _ in range(3):
        with StateStore(tmp_path) as keeper:
            state = keeper.load(CAMERAS)
            for track in range(state.first_track, state.first_track + 120):
                keeper.note(track, 0)
            used = state.first_track + 120
    (tmp_path / "counters.json").write_bytes(garbage)
    after = StateStore(tmp_path).load(CAMERAS)
    assert after.epoch > 3
    assert after.first_track >= used
    assert StateStore(tmp_path).load(CAMERAS).epoch > after.epoch
