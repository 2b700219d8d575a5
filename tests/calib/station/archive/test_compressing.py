"""A compressed recording holds what it held, opens in anybody's reader, and cut off is read up to its last chunk."""

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from calib.station.archive.compressing import CHUNK_BYTES, compress, is_compressed, main
from calib.station.archive.recording import Recorder, read
from edge.common.errors import RecordingError
from tests.places import ROOT

T = 1_800_000_000 * 10**9
KEYS = ("skyfix/1/s/cam/cam0/tracks", "skyfix/1/s/station/targets", "skyfix/1/s/station/own")


def recorded(folder: Path, count: int, *, seed: int = 1, finished: bool = True) -> Path:
    """A recording of messages like those of a station."""
    random = np.random.default_rng(seed)
    recorder = Recorder(folder, "s", min_free_mb=1)
    for k in range(count):
        payload = {"t_unix_ns": T + k, "rows": random.normal(size=random.integers(0, 40)).tolist(), "epoch": 7}
        recorder.write(KEYS[k % 3], json.dumps(payload).encode(), T + k, T + k - 5)
    assert recorder.path is not None
    if finished:
        recorder.close()
    return recorder.path


def test_it_is_smaller_and_holds_the_same(tmp_path: Path) -> None:
    path = recorded(tmp_path, 3000)
    before, size = list(read(path)), path.stat().st_size
    assert not is_compressed(path)
    compress(path)
    assert is_compressed(path)
    assert list(read(path)) == before
    assert path.stat().st_size < size / 2
    assert sorted(tmp_path.iterdir()) == [path]
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 3000
        assert {channel.topic for channel in summary.channels.values()} == set(KEYS)
        first = next(iter(reader.iter_messages(topics=[KEYS[1]])))
        assert (first[2].log_time, first[2].publish_time, first[2].sequence) == (T + 1, T - 4, 1)
        assert reader.get_header().profile == "skyfix"


def test_cut_off_anywhere_it_is_read_up_to_the_last_whole_chunk(tmp_path: Path) -> None:
    path = recorded(tmp_path, 3000)
    compress(path)
    whole, messages, cut = path.read_bytes(), list(read(path)), tmp_path / "cut.mcap"
    lost = CHUNK_BYTES // min(len(message.payload) + 31 for message in messages)  # 31: of a record, beside its payload
    held, best = [], 0
    for size in sorted({8, len(whole), *np.random.default_rng(3).integers(8, len(whole), 120).tolist()}):
        cut.write_bytes(whole[:size])
        got = list(read(cut))
        assert got == messages[: len(got)]
        assert len(got) >= best
        best = len(got)
        held.append(best)
    assert held[-1] == len(messages)
    assert max(np.diff(sorted(set(held)))) <= lost


def test_one_that_was_cut_off_before_keeps_what_can_be_read_and_gets_an_end(tmp_path: Path) -> None:
    path = recorded(tmp_path, 300, finished=False)
    content = path.read_bytes()
    for size in range(60, len(content), 997):
        path.write_bytes(content[:size])
        before = list(read(path))
        compress(path)
        assert list(read(path)) == before


@given(junk=st.binary(max_size=120), at=st.floats(0, 1))
def test_no_bytes_in_a_compressed_file_stop_the_reader(
    junk: bytes, at: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = recorded(tmp_path_factory.mktemp("r"), 40)
    compress(path)
    whole = path.read_bytes()
    place = 8 + round(at * (len(whole) - 8))
    path.write_bytes(whole[:place] + junk + whole[place + len(junk) :])
    assert len(list(itertools.islice(read(path), 200))) <= 200


def test_what_is_no_recording_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(RecordingError):
        compress(path)
    assert path.read_bytes() == b"nothing of the kind"
    before = os.nice(0)
    assert main([str(path)]) == 1
    assert os.nice(0) == before  # only a process of its own steps back
    assert sorted(tmp_path.iterdir()) == [path]


def test_killed_half_way_the_file_is_as_it_was(tmp_path: Path) -> None:
    path = recorded(tmp_path, 20_000)
    content = path.read_bytes()
    command = [sys.executable, "-m", "calib.station.archive.compressing", str(path)]
    with subprocess.Popen(command, cwd=ROOT) as child:
        part = path.with_name(path.name + ".part")
        while not part.exists() and child.poll() is None:
            pass
        child.kill()
    assert path.read_bytes() == content or is_compressed(path)
