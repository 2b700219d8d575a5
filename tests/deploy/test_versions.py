"""Which version is current, which one `rollback` leads to, and what is pruned."""

from pathlib import Path

import pytest

from deploy.installer.versions import Versions


@pytest.fixture
def versions(tmp_path: Path) -> Versions:
    return Versions(tmp_path)


def laid(versions: Versions, name: str, roles: str = "edge") -> Path:
    folder = versions.prefix / name
    (folder / "bin").mkdir(parents=True)
    (folder / "bin/python").touch()
    (folder / ".roles").write_text(roles)
    return folder


def test_nothing_is_laid(versions: Versions) -> None:
    assert (versions.current, versions.previous, versions.laid()) == (None, None, [])


def test_a_version_is_current_once_it_is_switched_to(versions: Versions) -> None:
    one, two = laid(versions, "0.1.0"), laid(versions, "0.2.0")
    versions.switch(one)
    versions.switch(two)
    assert versions.current == two
    assert (versions.prefix / "current").readlink() == Path("0.2.0")


def test_the_same_version_is_laid_beside_itself(versions: Versions) -> None:
    assert versions.name_for("0.1.0").name == "0.1.0"
    laid(versions, "0.1.0")
    laid(versions, "0.1.0.2")
    assert versions.name_for("0.1.0").name == "0.1.0.3"


def test_current_and_previous_are_kept_and_the_rest_goes(versions: Versions) -> None:
    for name in ("0.1.0", "0.2.0", "0.3.0", "0.4.0"):
        laid(versions, name)
    versions.switch(versions.prefix / "0.4.0")
    versions.remember(versions.prefix / "0.2.0")
    assert versions.prune() == ["0.1.0", "0.3.0"]
    assert [folder.name for folder in versions.laid()] == ["0.2.0", "0.4.0"]


def test_a_link_to_a_version_that_is_gone_is_no_version(versions: Versions) -> None:
    laid(versions, "0.1.0")
    versions.remember(versions.prefix / "0.0.9")
    assert versions.previous is None


def test_what_a_killed_installer_left_is_cleared(versions: Versions) -> None:
    laid(versions, "0.1.0")
    (versions.prefix / "0.2.0.new-123/lib").mkdir(parents=True)
    versions.clear_remains()
    assert [path.name for path in versions.prefix.iterdir()] == ["0.1.0"]


def test_roles_of_an_older_installer_are_understood(versions: Versions) -> None:
    folder = laid(versions, "0.1.0")
    (folder / ".roles").unlink()
    (folder / ".complete-edge").touch()
    (folder / ".complete-base").touch()
    assert versions.roles(folder) == {"edge", "base"}


def test_only_what_was_seen_to_run_came_up(versions: Versions) -> None:
    folder = laid(versions, "0.1.0")
    assert not versions.came_up(folder)
    versions.mark(folder)
    assert versions.came_up(folder)
    assert not versions.came_up(None)
