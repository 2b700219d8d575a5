"""CSV files of every dialect say the same; what cannot be told is refused with its line, never with a traceback."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.station.archive import tables, track_columns
from edge.common.errors import ConfigError

NAMES = ("t_unix_ns", "u_px", "v_px")
T_NS = 1_780_000_000_123_456_789
ROWS = [(T_NS + k * 33_000_111, 900.25 + k, 500.5 - k) for k in range(12)]


def text_of(separator: str = ",", end: str = "\n", *, comma: bool = False, header: str | None = None) -> str:
    """The rows in a dialect."""
    lines = [header or separator.join(NAMES)]
    for t, u, v in ROWS:
        values = [str(t), str(u), str(v)]
        lines.append(separator.join(value.replace(".", ",") if comma else value for value in values))
    return end.join([*lines, ""])


def read(folder: Path, data: bytes | str) -> tuple[np.ndarray, np.ndarray]:
    file = folder / "cam0.csv"
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    table = tables.read(file, NAMES)
    stamps, good = track_columns.stamps(table)
    assert good.all()
    return stamps, np.column_stack([table.numbers("u_px"), table.numbers("v_px")])


@pytest.mark.parametrize(
    "data",
    [
        text_of(),
        text_of().encode("utf-8-sig"),
        text_of("\t").encode("utf-16"),
        text_of(end="\r\n"),
        text_of(end="\r"),
        text_of(end="\r\r\n"),
        text_of(";"),
        text_of(";", "\r\n", comma=True),
        text_of(";", "\r\n", comma=True).encode("utf-8-sig"),
        text_of("\t", comma=True),
        text_of(";", comma=True).replace(",25", ",250").replace(",5", ",500"),
        text_of("\t"),
        text_of(", "),
        "sep=;\r\n" + text_of(";", comma=True),
        text_of(header=" T_UNIX_NS , U_px,V_PX  "),
        text_of(header='"t_unix_ns","u_px","v_px"'),
        text_of().replace(",", '","').replace("\n", '"\n"').join('""').removesuffix('""'),
        "# by hand\n\n" + text_of().replace("\n", "\n\n"),
        text_of() + "\n\n,,\n \n",
        text_of().replace("\n", ",,\n"),
        text_of(";").replace("\n", ";\n"),
        text_of() + "\x1a",
        text_of().replace(str(T_NS), f"{T_NS}.0"),
        text_of() + text_of().splitlines()[0] + "\n",
        '"' + text_of(comma=True, separator='","').replace("\n", '"\n"').removesuffix('"'),
    ],
)
def test_dialects_say_the_same(data: bytes | str, tmp_path: Path) -> None:
    stamps, pixels = read(tmp_path, data)
    assert stamps.tolist() == [t for t, _, _ in ROWS]
    assert pixels.tolist() == [[u, v] for _, u, v in ROWS]


@pytest.mark.parametrize(("scale", "unit"), [(10**9, "seconds"), (10**6, "milliseconds"), (10**3, "microseconds")])
@pytest.mark.parametrize("decimals", [0, 3])
def test_stamps_in_another_unit_are_read_and_said(
    scale: int, unit: str, decimals: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    if unit == "seconds" and decimals == 0:
        pytest.skip("whole seconds are refused below")
    lines = ["t_unix_ns,u_px,v_px"]
    lines += [f"{t // scale}.{str(t % scale).rjust(len(str(scale)) - 1, '0')[:decimals]},{u},{v}" for t, u, v in ROWS]
    stamps, _ = read(tmp_path, "\n".join(lines))
    step = scale // 10**decimals
    assert np.abs(stamps - [t for t, _, _ in ROWS]).max() <= step
    assert f"is in {unit}" in caplog.text


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", ["no column t_unix_ns", "is empty"]),
        ("\n\n# only\n", ["no column t_unix_ns", "is empty"]),
        ("frame,x,y\n1,2,3", ["no column t_unix_ns", "line 1 has frame, x, y"]),
        ("1780000000000000000,2,3", ["no column t_unix_ns", "line 1 has 1780000000000000000"]),
        ("t_unix_ns u_px v_px\n1 2 3", ["no column t_unix_ns", "line 1 has t_unix_ns u_px v_px"]),
        (f"t_unix_ns,u_px,v_px\n{T_NS},1", ["line 2", "has 2 of 3 columns"]),
        (f"t_unix_ns,u_px,v_px\n\n{T_NS},1,2,3", ["line 3", "has 4 of 3 columns"]),
        (f"t_unix_ns,u_px,v_px\n{T_NS},1,2\n{T_NS},left,2", ["line 3", "u_px", "'left' is no number"]),
        (f"t_unix_ns,u_px,v_px\n{T_NS},1_0,2", ["line 2", "'1_0' is no number"]),
        (f'# x\r\nt_unix_ns,u_px,v_px\r\n{T_NS},"1,2', ["line 3", "quotation mark"]),
        (f'# x\rt_unix_ns,u_px,v_px\r{T_NS},"1,2\r{T_NS}",3', ["line 3", "quotation mark"]),
        (f't_unix_ns,u_px,v_px\n{T_NS},"1,234","2"', ["line 2", "decimal comma or a comma between thousands"]),
        (f"t_unix_ns;u_px;v_px\n{T_NS};1,234.5;2", ["line 2", "decimal comma or a comma between thousands"]),
        ("t_unix_ns,u_px,u_px,v_px\n1,2,3,4", ["line 1", "two columns are named u_px"]),
        ("t_unix_ns,u_px,v_px\n2026-11-30T10:00:00Z,1,2", ["line 2", "'2026-11-30T10:00:00Z' is no number"]),
        ("t_unix_ns,u_px,v_px\n" + "".join(f"{k / 30},1,2\n" for k in range(9)), ["line 2", "no time since 1970"]),
        ("t_unix_ns,u_px,v_px\n" + "".join(f"{k},1,2\n" for k in range(9)), ["line 2", "no time since 1970"]),
        ("t_unix_ns,u_px,v_px\n" + "1.78E+18,1,2\n" * 9, ["line 2", "1.78E+18 have lost their digits"]),
        ("t_unix_ns;u_px;v_px\n" + "1,78E+18;1;2\n" * 9, ["line 2", "1,78E+18 have lost their digits"]),
        ("t_unix_ns,u_px,v_px\n" + "1780000000,1,2\n" * 9, ["line 2", "lost their digits", "9 rows have 1 different"]),
    ],
)
def test_what_cannot_be_told_is_refused_with_its_line(text: str, named: list[str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, text)
    for words in ("cam0.csv", *named):
        assert words in str(caught.value)


def test_three_objects_under_one_number_have_not_lost_their_digits(tmp_path: Path) -> None:
    """Ten frames a second, all of whose stamps end in zeros, and three drones in each that a detector counts as one."""
    rows = [
        f"{T_NS // 10**9 * 10**9 + k * 10**8},{100 + 300 * n + 3 * k},{50 + 2 * k},1"
        for k in range(40)
        for n in range(3)
    ]
    stamps, _ = read(tmp_path, "t_unix_ns,u_px,v_px,track\n" + "\n".join(rows))
    assert len(np.unique(stamps)) == 40


def test_one_object_at_thirty_frames_and_tenths_of_a_second_has(tmp_path: Path) -> None:
    rows = [f"{T_NS // 10**9 * 10**9 + k // 3 * 10**8},{100 + k},{50 + k},1" for k in range(120)]
    with pytest.raises(ConfigError, match="lost their digits"):
        read(tmp_path, "t_unix_ns,u_px,v_px,track\n" + "\n".join(rows))


@pytest.mark.parametrize("data", [text_of("\t").encode("utf-16-le"), text_of().encode("utf-16-be"), b"\xff\xfe\x00"])
def test_what_is_no_text_in_utf_8_is_named(data: bytes, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cam0\.csv"):
        read(tmp_path, data)
    with pytest.raises(ConfigError, match=r"line 3: is not text in UTF-8"):
        read(tmp_path, b"#\r\nt_unix_ns,u_px,v_px\r\n1,2,\xfc\r\n")


def test_a_value_that_is_not_said_is_none(tmp_path: Path) -> None:
    file = tmp_path / "cam0.csv"
    said = ["", "nan", "NaN", "NA", "#N/A", "null", "None", "-"]
    file.write_text("t_unix_ns,u_px,v_px\n" + "".join(f"{T_NS},{value},1\n" for value in said))
    assert np.isnan(tables.read(file, NAMES).numbers("u_px")).all()


@pytest.mark.parametrize(
    ("written", "alike"),
    [
        (["1", "1.0", "1,0", "2"], [0, 0, 0, 1]),
        (["nan", "", "None", "0"], [0, 0, 0, 0]),
        (["drone", "bird", "drone", "7"], [0, 1, 0, 2]),
        (["1e20", "1e20", "-1e20", "inf"], [0, 0, 1, 2]),
        (["1.5", "1", "2", "1.5"], [0, 1, 2, 0]),
        ([str(10**30), str(10**30), "5", "-1"], [0, 0, 1, 2]),
    ],
)
def test_tracks_are_told_apart_by_any_name(written: list[str], alike: list[int], tmp_path: Path) -> None:
    file = tmp_path / "cam0.csv"
    file.write_text("t_unix_ns;u_px;v_px;track\n" + "".join(f"{T_NS};1;1;{value}\n" for value in written))
    found = track_columns.tracks(tables.read(file, NAMES))
    assert [[int(a) == int(b) for b in found] for a in found] == [[a == b for b in alike] for a in alike]
    assert found.min() >= 0
    assert found.max() < track_columns.TRACK_NUMBERS


@given(data=st.one_of(st.binary(max_size=300), st.text("t_unix_ns,uvp;\t\r\n\"'0123456789.-+eE#naN ", max_size=300)))
def test_any_bytes_are_read_or_refused_by_name(data: bytes | str, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "any.csv"
    body = data if isinstance(data, bytes) else data.encode()
    for head in (b"", b"t_unix_ns,u_px,v_px,track\n", b"t_unix_ns;u_px;v_px;track\r1780000000000000000;1;2;3\r"):
        file.write_bytes(head + body)
        try:
            table = tables.read(file, NAMES)
            track_columns.stamps(table)
            track_columns.tracks(table)
            table.numbers("u_px")
        except ConfigError as error:
            assert str(file) in str(error)  # noqa: PT017
