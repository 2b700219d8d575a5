"""A recording cut at any byte is read up to there; a finished one opens in anybody's reader."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from calib.station.archive.recording import MOST_KEYS, Recorder, read
from edge.common.errors import RecordingError

T = 1_800_000_000 * 10**9
KEYS = (
    "skyfix/1/s/cam/cam0/tracks",
    "skyfix/1/s/cam/cam1/lens",
    "skyfix/1/s/station/targets",
    "skyfix/1/s/station/mavlink",
)


def written(folder: Path, count: int = 40, **options: int) -> tuple[Recorder, list[bytes]]:
    """A recorder that has taken some messages, and what they were."""
    recorder = Recorder(folder, "s", **{"min_free_mb": 1, **options})  # type: ignore[arg-type]
    payloads = [b'{"n":%d}' % k for k in range(count)]
    for k, payload in enumerate(payloads):
        recorder.write(KEYS[k % len(KEYS)], payload, T + k)
    return recorder, payloads


def test_what_was_written_is_read_before_the_file_is_finished_and_after(tmp_path: Path) -> None:
    recorder, payloads = written(tmp_path)
    assert recorder.path is not None
    assert [message.payload for message in read(recorder.path)] == payloads
    recorder.close()
    again = list(read(recorder.path))
    assert [message.payload for message in again] == payloads
    assert [message.key for message in again[:4]] == list(KEYS)
    assert [message.t_arrival_ns for message in again] == [T + k for k in range(40)]


def test_more_names_than_any_site_has_are_left_out_and_counted(tmp_path: Path) -> None:
    """The format counts keys to 65535, and each that is known takes memory: a stranger with many names ended a base."""
    recorder = Recorder(tmp_path, "s", min_free_mb=1)
    for number in range(MOST_KEYS + 50):
        for topic in ("tracks", "lens"):
            recorder.write(f"skyfix/1/s/cam/c{number}/{topic}", b"{}", T + number)
    recorder.close()
    assert recorder.path is not None
    assert recorder.messages == MOST_KEYS
    assert recorder.left_out == 2 * 50 + MOST_KEYS
    assert len({message.key for message in read(recorder.path)}) == MOST_KEYS


def test_cut_at_any_byte_it_is_read_up_to_there(tmp_path: Path) -> None:
    recorder, payloads = written(tmp_path, count=12)
    recorder.close()
    assert recorder.path is not None
    whole, cut, best = recorder.path.read_bytes(), tmp_path / "cut.mcap", 0
    for size in range(8, len(whole)):
        cut.write_bytes(whole[:size])
        got = [message.payload for message in read(cut)]
        assert got == payloads[: len(got)]
        assert len(got) >= best, "a longer piece never holds less"
        best = len(got)
    assert best == len(payloads)


@given(junk=st.binary(max_size=200))
def test_no_bytes_stop_the_reader(junk: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    recorder, payloads = written(tmp_path_factory.mktemp("r"), count=5)
    recorder.close()
    assert recorder.path is not None
    whole = recorder.path.read_bytes()
    recorder.path.write_bytes(whole[: len(whole) // 2] + junk)
    assert len(list(read(recorder.path))) <= len(payloads) + 2


def test_other_readers_find_one_channel_a_key_and_json_with_its_schema(tmp_path: Path) -> None:
    recorder, payloads = written(tmp_path)
    recorder.close()
    assert recorder.path is not None
    with recorder.path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(payloads)
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert set(channels) == set(KEYS)
    assert {channel.message_encoding for channel in channels.values()} == {"json"}
    schema = summary.schemas[channels[KEYS[0]].schema_id]
    assert (schema.name, schema.encoding) == ("Tracks", "jsonschema")
    assert "Tracks" in json.loads(schema.data)["$defs"]


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(b"this is no recording at all")
    with pytest.raises(RecordingError, match="is no recording"):
        list(read(path))
    with pytest.raises(RecordingError, match="cannot be read"):
        list(read(tmp_path / "missing.mcap"))


def test_files_are_limited_in_size(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, "s", max_file_mb=1, min_free_mb=1)
    for k in range(30):
        recorder.write(KEYS[0], b'"' + b"x" * 100_000 + b'"', T + k * 10**9)
    recorder.close()
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) == 3
    assert sum(len(list(read(path))) for path in files) == 30


def test_a_full_disk_stops_the_recording_and_nothing_else(tmp_path: Path) -> None:
    recorder, _ = written(tmp_path, min_free_mb=10**6)
    assert "left on the disk" in recorder.fault
    recorder.close()


def test_a_folder_that_cannot_be_written_is_a_fault_not_an_exception(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recorder = Recorder(tmp_path / "file" / "below", "s", min_free_mb=1)
    recorder.write(KEYS[0], b"{}", T)
    assert "recording stopped" in recorder.fault
    recorder.close()


def test_each_file_begins_with_what_was_said_once_and_holds_on(tmp_path: Path) -> None:
    """Of the last of each key; a file after the first must be solved by itself, and so must one begun anew."""
    survey, lens = "skyfix/1/s/station/survey", "skyfix/1/s/cam/cam0/lens"
    recorder = Recorder(tmp_path, "s", max_file_mb=1, min_free_mb=1)
    recorder.hold(survey, b'{"is":"held"}')
    recorder.write(lens, b'{"n":1}', T)
    recorder.write(lens, b'{"n":2}', T + 1)
    for k in range(12):
        recorder.write(KEYS[0], b'"' + b"x" * 100_000 + b'"', T + k * 10**9)
    recorder.close()
    recorder.hold(lens, b'{"n":3}')  # came while nothing was recorded
    recorder.write(KEYS[0], b'{"n":0}', T + 99 * 10**9)
    recorder.close()
    first, second, third = (
        [(message.key, message.payload) for message in read(path)] for path in sorted(tmp_path.glob("*.mcap"))
    )
    assert first[:3] == [(survey, b'{"is":"held"}'), (lens, b'{"n":1}'), (lens, b'{"n":2}')]
    assert second[:2] == [(survey, b'{"is":"held"}'), (lens, b'{"n":2}')]
    assert third == [(survey, b'{"is":"held"}'), (lens, b'{"n":3}'), (KEYS[0], b'{"n":0}')]
