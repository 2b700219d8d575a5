"""`survey boxes`, with real Zenoh: whether the station runs or not, it takes what the station would take."""

import argparse
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import pytest
import tomli_w
from msgspec.structs import replace

from calib.station.commands import survey as survey_command
from calib.station.commands.run import run_station
from calib.station.config import load
from calib.station.survey.in_force import with_survey
from calib.station.survey.store import load_survey
from edge.common.errors import ConfigError
from edge.link.link import Link
from edge.link.ports import ANY_NAME, beside_listener, place, why_not_free
from edge.link.settings import LinkSettings, TlsSettings
from edge.messages import Fix, camera_key
from tests.edge.link.test_security import certs
from tools.doubles.ports import free_port

SITE = "hill"
NAMES = ("cam0", "cam1", "cam2")
HEIGHT_M = 500.0
RUNS_WITHIN_S = 30.0  # on a busy machine


def fix(name: str, quality: int = 4, of: str = "lens") -> Fix:
    """A box's position, its height its own."""
    return Fix(
        t_unix_ns=1_790_000_000 * 10**9, lat_deg=48.1, lon_deg=11.5, height_m=HEIGHT_M + NAMES.index(name),
        quality=quality, sigma_m=(0.01, 0.01, 0.02), frame="EPSG:7931", samples=200, of=of,
    )  # fmt: skip


@pytest.fixture
def configure(tmp_path: Path, endpoint: str) -> Callable[..., Path]:
    """Write base.toml for three boxes; its path."""

    def write(port: int = 0, **link: object) -> Path:
        config = {
            "site": {"name": SITE},
            "state_folder": "state",
            "camera": [{"id": name} for name in NAMES],
            "link": {"listen": [endpoint]} | link,
            "status": {"port": port, "page": False},
        }
        (tmp_path / "base.toml").write_text(tomli_w.dumps(config))
        return tmp_path / "base.toml"

    return write


def survey_boxes(base: Path, *more: str, seconds: float = RUNS_WITHIN_S, says: str = "n") -> int:
    """The command, and an operator who says this to every question."""
    parser = argparse.ArgumentParser()
    survey_command.add_arguments(parser)
    arguments = parser.parse_args(["--config", str(base), "boxes", "--seconds", str(seconds), *more])
    return survey_command.run(arguments, lambda _: says)


@contextmanager
def boxes(settings: Callable[[str], LinkSettings], fixes: list[Fix | None]) -> Iterator[None]:
    """Boxes that dial the station and have said their positions."""
    with ExitStack() as stack:
        for name, message in zip(NAMES, fixes, strict=True):
            link = stack.enter_context(Link(settings(name), name=name))
            link.declare_presence(camera_key(SITE, name))
            if message is not None:
                link.set_state(camera_key(SITE, name, "fix"), message)
        yield


@contextmanager
def running(base: Path, until: Callable[..., bool]) -> Iterator[None]:
    """A station that runs."""
    config, stop = load(base), threading.Event()
    station = threading.Thread(target=run_station, args=(config, base.parent), kwargs={"stop": stop})
    station.start()
    try:
        assert until(lambda: why_not_free(*place(config.link.listen[0])), within_s=RUNS_WITHIN_S)
        yield
    finally:
        stop.set()
        station.join()


def heights(base: Path) -> list[float | None]:
    """The heights that the station will use."""
    sections = with_survey(load(base), base.parent).values()
    return [None if section.position is None else section.position[2] for section in sections]


EXPECTED = [HEIGHT_M, HEIGHT_M + 1, HEIGHT_M + 2]


@pytest.mark.parametrize("runs", [False, True])
def test_the_boxes_are_asked_whether_the_station_runs_or_not(
    configure: Callable[..., Path], endpoint: str, until: Callable[..., bool], runs: bool
) -> None:
    base = configure()
    with ExitStack() as stack:
        if runs:
            stack.enter_context(running(base, until))
        stack.enter_context(boxes(lambda _: LinkSettings(connect=(endpoint,)), [fix(name) for name in NAMES]))
        assert survey_boxes(base) == 0
    assert heights(base) == EXPECTED


def test_a_station_with_certificates_is_asked_with_its_own(
    configure: Callable[..., Path], endpoint: str, until: Callable[..., bool], tmp_path: Path
) -> None:
    folder = tmp_path / "certs"
    certs(folder, "init", SITE)
    for name in NAMES:
        certs(folder, "issue", name)
    # Another address than the loopback that a second program on this machine dials.
    certs(folder, "issue", "base", "--role", "station", "--address", "127.0.0.2")

    def tls(name: str, **access: str) -> dict[str, str]:
        return {
            key: str(folder / "issued" / name / f"{key}.pem") for key in ("authority", "certificate", "key")
        } | access

    port = endpoint.rpartition(":")[2]
    base = configure(listen=[f"tls/0.0.0.0:{port}"], tls=tls("base", access=str(folder / "access.json")))

    def settings(name: str) -> LinkSettings:
        return LinkSettings(connect=(f"tls/127.0.0.2:{port}",), tls=TlsSettings(**tls(name)))

    with running(base, until), boxes(settings, [fix(name) for name in NAMES]):
        assert survey_boxes(base) == 0
    assert heights(base) == EXPECTED


def test_what_the_station_would_refuse_is_not_stored(
    configure: Callable[..., Path], endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    base = configure()
    with boxes(lambda _: LinkSettings(connect=(endpoint,)), [fix("cam0"), fix("cam1", quality=5), None]):
        assert survey_boxes(base, seconds=6.0) == 0
    printed = capsys.readouterr()
    assert heights(base) == [HEIGHT_M, None, None]
    assert "cam1: its receiver has quality 5" in printed.err
    assert "cam2: no position came" in printed.err


def test_a_fix_of_the_antenna_is_stored_with_a_sigma_that_covers_the_offset_and_said(
    configure: Callable[..., Path], endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    base = configure()
    with boxes(lambda _: LinkSettings(connect=(endpoint,)), [fix(name, of="antenna") for name in NAMES]):
        assert survey_boxes(base) == 0
    table = load_survey(base.parent / "survey.toml").of("cam0")
    assert table is not None
    assert table.position_sigma is not None
    assert table.position_sigma[2] > 0.3
    assert "of its antenna" in table.entered.source if table.entered else False
    assert "gnss.lever_arm_m" in capsys.readouterr().err


def test_nothing_that_came_is_an_error_that_says_whom_it_asked(configure: Callable[..., Path]) -> None:
    with pytest.raises(ConfigError, match="no box has sent a position") as caught:
        survey_boxes(configure(), seconds=0.2)
    assert "edge-node check" in caught.value.action


def test_a_second_program_dials_a_listener_everywhere_at_loopback(endpoint: str) -> None:
    port = int(endpoint.rpartition(":")[2])
    assert beside_listener(LinkSettings(listen=(endpoint,))) == LinkSettings(listen=(endpoint,))
    with Link(LinkSettings(listen=(f"tcp/0.0.0.0:{port}",), insecure=True), name="station") as link:
        assert link.wait_open(10)
        plain = beside_listener(LinkSettings(listen=(f"tcp/0.0.0.0:{port}",), insecure=True))
        assert (plain.mode, plain.connect, plain.listen) == ("client", (f"tcp/127.0.0.1:{port}",), ())
        tls = TlsSettings(authority="a", certificate="c", key="k", access="l")
        secure = beside_listener(LinkSettings(listen=(f"tls/0.0.0.0:{port}#x=y",), tls=tls))
        assert secure.connect == (f"tls/127.0.0.1:{port}{ANY_NAME}",)
        named = beside_listener(LinkSettings(listen=(f"tls/127.0.0.1:{port}",), tls=tls))
        assert named.connect == (f"tls/127.0.0.1:{port}",)


def test_what_the_station_that_runs_doubts_is_stored_only_on_the_operators_word(
    configure: Callable[..., Path], endpoint: str, until: Callable[..., bool], capsys: pytest.CaptureFixture[str]
) -> None:
    """A box that was restarted after its base had been switched knows of no other place; the station does."""
    base = configure(port=free_port())
    with running(base, until):
        with boxes(lambda _: LinkSettings(connect=(endpoint,)), [fix(name) for name in NAMES]):
            assert until(lambda: sum(camera["surveyed"] for camera in told(base, "cameras")) == 3, RUNS_WITHIN_S)
        elsewhere = [replace(fix(NAMES[0]), lat_deg=fix(NAMES[0]).lat_deg + 1.3 / 111_200), *map(fix, NAMES[1:])]
        with boxes(lambda _: LinkSettings(connect=(endpoint,)), elsewhere):
            doubt = f"position {NAMES[0]}"
            assert until(lambda: doubt in [item["name"] for item in told(base, "health").get("items", [])])
            assert survey_boxes(base) == 1
            assert "its sigma covers both" in capsys.readouterr().err
            assert heights(base) == [None, *EXPECTED[1:]]
            assert survey_boxes(base, "--yes") == 0
    assert heights(base) == EXPECTED


def told(base: Path, what: str) -> Any:
    """What the station that runs says of itself; nothing while it starts."""
    try:
        with urlopen(f"http://127.0.0.1:{load(base).status.port}/status.json", timeout=RUNS_WITHIN_S) as answer:
            return json.load(answer)[what]
    except URLError:
        return {}
