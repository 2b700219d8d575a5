"""Whatever a file holds, it is a tree or a ValueError, and the program says which file."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import CalibrationError
from calib.network import from_toml, to_toml
from edge.common.errors import ConfigError
from edge.common.settings import parse
from edge.common.toml_text import DEEPEST, read_toml
from edge.link.settings import LinkSettings
from tools.doubles.flight import Spec, make

ENDLESS = (
    "a = " + "[" * 20_000 + "]" * 20_000,
    "a = " + "[" * 20_000,
    "[" * 50_000,
    ".".join("a" * 5_000) + " = 1",
    "a = " + "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1),
    "a = " + "9" * 5_000,
    "a = " + "{b = " * 3_000 + "1" + "}" * 3_000,
)


@pytest.mark.parametrize("text", ENDLESS, ids=range(len(ENDLESS)))
def test_what_has_no_end_is_refused_by_everybody_who_reads_it(text: str) -> None:
    """It ended the base at every start, with a traceback and the exit code that has it started again."""
    with pytest.raises(ValueError, match=r"."):
        read_toml(text)
    with pytest.raises(ConfigError, match=r"base\.toml"):
        parse(text, LinkSettings, where="base.toml")
    with pytest.raises(CalibrationError, match=r"network\.toml.*calibrate again"):
        from_toml(text)


@given(st.text() | st.text(alphabet='[]{}=.a1"\n'))
def test_any_text_is_a_tree_or_a_value_error(text: str) -> None:
    try:
        assert isinstance(read_toml(text), dict)
    except ValueError:
        return


@pytest.mark.parametrize(
    ("now", "then"),
    [
        ("rms_px = 1.0", "rms_px = nan"),
        ("clock_offset_s = 0.0", "clock_offset_s = inf"),
        ("readout_s = 0.0", "readout_s = -inf"),
        ("t_mid_unix_ns = 1", "t_mid_unix_ns = " + "9" * 40 + "1"),
        ("t_mid_unix_ns = ", "t_mid_unix_ns = -"),
        ("rms_px = 1.0", "rms_px = 1" + "0" * 400),
    ],
)
def test_a_network_of_numbers_that_are_none_is_no_network(now: str, then: str) -> None:
    text = to_toml(make(Spec(cameras=3, uavs=1, duration_s=1.0)).network)
    assert now in text
    with pytest.raises(CalibrationError, match="not a network"):
        from_toml(text.replace(now, then, 1))
