"""Debian packages: what dpkg runs is shell, every word in it is replaced, and units start what the package has."""

import subprocess
from pathlib import Path

import pytest

from deploy.installer.unpacking import PROGRAM
from tools.debs.__main__ import COMMON, LEANS_ON, QUESTIONS, common
from tools.debs.package import SCRIPTS, documents, scripts
from tools.debs.tree import PACKAGES, roles


@pytest.mark.parametrize("role", roles(), ids=lambda role: role.name)
def test_scripts_are_whole(tmp_path: Path, role) -> None:  # type: ignore[no-untyped-def]
    name = PACKAGES[role.name]
    words = {"PACKAGE": name, "ROLE": role.name, "UNIT": role.unit, "QUESTIONS": QUESTIONS[role.name]}
    scripts(tmp_path, "role", words)
    made = sorted((tmp_path / "DEBIAN").iterdir())
    assert [file.name for file in made] == ["config", "postinst", "postrm", "preinst", "prerm"]
    for file in made:
        assert "@" not in file.read_text().replace('"$@"', ""), file
        subprocess.run(["sh", "-n", str(file)], check=True)
    templates = (SCRIPTS / f"{name.removeprefix('skyfix-')}.templates").read_text()
    for question in QUESTIONS[role.name].split():
        assert f"Template: {name}/{question}\n" in templates


def test_what_all_share_starts_nothing_of_the_other_way_of_installing(tmp_path: Path) -> None:
    common(tmp_path)
    documents(tmp_path, COMMON.name, "common")
    units = sorted((tmp_path / "lib/systemd/system").iterdir())
    assert [unit.name for unit in units] == ["skyfix-access.path", "skyfix-access.service", "skyfix-ntrip.service"]
    assert all("/opt/" not in unit.read_text() for unit in units)
    assert (tmp_path / "usr/share/skyfix/deploy/installer/configuration.py").exists()


def test_a_control_file_names_its_version_and_what_it_leans_on() -> None:
    text = COMMON.control(12)
    assert text.startswith("Package: skyfix-common\nVersion: ")
    assert "Installed-Size: 12\n" in text
    assert "skyfix-common (= " in LEANS_ON


def test_a_program_does_nothing_when_the_solvers_process_loads_it_again(tmp_path: Path) -> None:
    """Without the guard an installed base starts itself in its solver, which dies."""
    (tmp_path / "program.py").write_text(
        PROGRAM.format(python="/usr/bin/python", module="os.path").replace("import main", "import join")
    )
    done = subprocess.run(
        ["python3", "-c", "import program"], cwd=tmp_path, check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
