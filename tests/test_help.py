"""`--help` of everything that can be typed."""

import pytest

from tests.programs import Words, actions, parsers


@pytest.mark.parametrize("words", sorted(parsers()), ids=" ".join)
def test_help_is_there_and_names_what_can_be_asked_for(words: Words, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parsers()[words].parse_args(["--help"])
    printed = capsys.readouterr().out
    assert ended.value.code == 0
    assert printed.startswith(f"usage: {words[0]}")
    assert all(action in printed for action in actions(words))
